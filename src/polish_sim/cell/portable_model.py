"""A model's XML written so that its folder may be moved: the files it needs are copied beside it (layer 8a)."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

ASSETS: Final = "meshes"
"""Folder beside the model that holds copies of what it needs."""
_TEXTURE_FILES: Final = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")


def write_portable(file: Path, xml: str) -> Path:
    """Write a model whose folders are absolute, as MuJoCo saves it, with copies of its files.

    Args:
        file: Where to; copies go to the folder `ASSETS` beside it.
        xml: The model.

    Returns:
        The model's file.
    """
    root = ElementTree.fromstring(xml)
    compiler = root.find("compiler")
    folders = {} if compiler is None else compiler.attrib
    taken: dict[str, Path] = {}
    for element in root.iterfind("asset/*"):
        beside = Path(folders.get("texturedir" if element.tag == "texture" else "meshdir", ""))
        for attribute in _TEXTURE_FILES:
            if attribute in element.attrib:
                source = beside / element.attrib[attribute]
                # Without a name of its own an asset has its file's.
                element.attrib.setdefault("name", source.stem)
                element.attrib[attribute] = _copied(source, file.parent / ASSETS, taken)
    if compiler is not None and taken:
        compiler.attrib.update(meshdir=ASSETS, texturedir=ASSETS)
    elif compiler is not None:
        for name in ("meshdir", "texturedir"):
            compiler.attrib.pop(name, None)
    ElementTree.indent(root)
    file.write_text(ElementTree.tostring(root, encoding="unicode") + "\n", encoding="utf-8")
    return file


def _copied(source: Path, folder: Path, taken: dict[str, Path]) -> str:
    """Copy a file under its own name, or with a number where another file has it."""
    name, count = source.name, 1
    while taken.get(name, source) != source:
        count += 1
        name = f"{source.stem}_{count}{source.suffix}"
    if name not in taken:
        folder.mkdir(exist_ok=True)
        shutil.copyfile(source, folder / name)
        taken[name] = source
    return name
