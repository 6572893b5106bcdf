"""Make the pictures of results/gallery again: `python -m benchmarks.gallery FOLDER`, and their contact sheet.

Every command below runs into a folder of its own in FOLDER, unless it is there already; the pictures the docs
show are copied to results/gallery, and a sheet of all pictures the commands draw, those of stopped runs too,
is put beside them.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

import imageio_ffmpeg
import trimesh
from PIL import Image, ImageDraw

from benchmarks.table import words

GALLERY: Final = Path(__file__).resolve().parent.parent / "results" / "gallery"
RUNS: Final = {
    "surface": "run surface",
    "position": "run surface --controller position --proof none",
    "compared": "report surface position",
    "demo": "demo",
    "force": "run force",
    "arc": "run arc",
    "teach": "run teach",
    "taught": "run teach --follow rim",
    "dual": "run dual --video",
    "smooth": "run smooth",
    "budget": "calibrate budget --draws 1000",
    "plan": "plan freeform --reach-map",
    "inspect": "inspect plan",
    "score": "score --controller hybrid-adaptive --against hybrid-pi --seeds 1",
    "border": "score --controller hybrid-adaptive --against hybrid-pi --border",
    # Not in the docs: on the sheet alone.
    "plan-holes": "plan plate_two_holes",
    "plan-side": "plan box.stl --up z --region point:60,0,0",
    "inspect-holes": "inspect plan-holes --stepover 8",
    "sphere": "run surface --part sphere_50",
    "force-stop": "run force --fault sensor-zeros@contact+1",
    "surface-stop": "run surface --fault sensor-jump@20",
    "surface-stop-at-once": "run surface --fault controller-nan@0",
    "arc-stop": "run arc --fault controller-nan@5",
    "dual-stop": "run dual --fault master-stop@20",
    "force-seeds": "run force --seeds 3",
    "sphere-seeds": "run surface --part sphere_50 --seeds 3",
    "arc-compared": "report arc arc-stop",
    "smoothed": "smooth plan --rule joint-jerk --against joint-acceleration",
    "ablation": "score --controller hybrid-adaptive --ablate --seeds 1 --case step-10 --case stiffness-2",
    "payload": "calibrate payload",
    "tcp": "calibrate tcp",
    "base": "calibrate base",
    "arms": "calibrate arm",
    "identify": "identify",
}
"""Commands by folder; a word that is a folder's name stands for that folder."""
SHOWN: Final = {
    "cell.png": "surface/cell.png",
    "plan_freeform.png": "plan/path.png",
    "surface_force.png": "surface/force.png",
    "removal.png": "surface/removal.png",
    "with_and_without_force_control.png": "compared/force.png",
    "force_step.png": "force/force.png",
    "arc.png": "arc/arc.png",
    "hand_force.png": "teach/hand_force.png",
    "taught.png": "taught/taught.png",
    "dual.png": "dual/dual.png",
    "dual_cell.png": "dual/cell.png",
    "budget.png": "budget/budget.png",
    "score.png": "score/score.png",
    "stability_border.png": "border/border.png",
    "smooth_tracking.png": "smooth/tracking.png",
    "inspect_freeform.png": "inspect/coverage.png",
}
"""Pictures of the gallery, and where they come from."""
DRAWN: Final = {
    "real_arc.png": "benchmarks.how_real",
    "patterns.png": "benchmarks.patterns --out",
}
"""Pictures of the gallery that benchmarks draw, and what the name of the file follows."""
MOST_BYTES: Final = 300_000  #: Of a picture of the gallery
COLORS: Final = (256, 128, 64)  #: Of those that would be larger
COLUMNS, WIDTH, CAPTION = 6, 330, 16  #: Of the sheet [pixels]
GIF: Final = (
    "setpts=PTS/3,fps=4,scale=600:-1:flags=lanczos,"
    "split[a][b];[a]palettegen=max_colors=64[p];[b][p]paletteuse=dither=none"
)


def make(folder: Path) -> None:
    """Run the commands whose folders are not there."""
    trimesh.creation.box((120.0, 120.0, 120.0)).export(folder / "box.stl")
    for name, command in DRAWN.items():
        if not (folder / name).exists():
            print(f"python -m {command} {name}", flush=True)
            subprocess.run(
                [sys.executable, "-m", *command.split(), str(folder / name)], capture_output=True, check=True
            )
    for name, command in RUNS.items():
        if not (folder / name).exists():
            print(f"polish-sim {command}", flush=True)
            program = [sys.executable, "-c", "from polish_sim.cli.main import app; app()"]
            done = subprocess.run(
                [*program, *command.split(), "--out", name], cwd=folder, capture_output=True, text=True
            )
            if done.returncode not in (0, 3):
                raise SystemExit(done.stderr)


def keep(source: Path, target: Path) -> None:
    """Copy a picture, with fewer colours if its file is large."""
    shutil.copyfile(source, target)
    for colors in COLORS:
        if target.stat().st_size > MOST_BYTES:
            image = Image.open(source).convert("RGB")
            image.quantize(colors, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(
                target, optimize=True
            )


def shoot_page(page: Path, target: Path) -> None:
    """The page of a run in Chromium, the part at 200 s."""
    from playwright.sync_api import sync_playwright

    words = ["--enable-unsafe-swiftshader", *(["--no-sandbox"] if os.geteuid() == 0 else [])]
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=words)
        tab = browser.new_page(viewport={"width": 1300, "height": 960})
        tab.goto(page.as_uri())
        tab.click("[data-view=part]")
        tab.evaluate(
            "s => { s.value = 200; s.dispatchEvent(new Event('input')); }", tab.query_selector("#scrubber")
        )
        tab.wait_for_timeout(3000)
        tab.screenshot(path=target)
        browser.close()


def sheet(folder: Path) -> Image.Image:
    """All pictures of the commands, smaller, each under its place and the command; lower ones fill the
    columns."""
    whole = Image.new("RGB", (COLUMNS * WIDTH, 20_000), "white")
    draw, ends = ImageDraw.Draw(whole), [0] * COLUMNS
    for name in RUNS:
        for file in sorted((folder / name).glob("*.png")):
            image = Image.open(file).convert("RGB")
            image = image.resize(
                (WIDTH - 8, round((WIDTH - 8) * image.height / image.width)), Image.Resampling.LANCZOS
            )
            column = ends.index(min(ends))
            place = column * WIDTH, ends[column]
            draw.text((place[0] + 4, place[1] + 2), f"{name}/{file.name}", fill="black", font_size=12)
            whole.paste(image, (place[0] + 4, place[1] + CAPTION))
            ends[column] += image.height + CAPTION + 8
    return whole.crop((0, 0, COLUMNS * WIDTH, max(ends)))


def main() -> None:
    """Run, copy, and lay the sheet out."""
    match words(__doc__):
        case [name]:
            folder = Path(name).resolve()
        case _:
            raise SystemExit(__doc__)
    folder.mkdir(parents=True, exist_ok=True)
    make(folder)
    for name, source in {**SHOWN, **{name: name for name in DRAWN}}.items():
        keep(folder / source, GALLERY / name)
    shoot_page(folder / "surface" / "report.html", folder / "page.png")
    keep(folder / "page.png", GALLERY / "report_page.png")
    ffmpeg = [
        imageio_ffmpeg.get_ffmpeg_exe(),
        "-loglevel",
        "error",
        "-y",
        "-i",
        str(folder / "dual" / "video.mp4"),
    ]
    subprocess.run([*ffmpeg, "-vf", GIF, str(GALLERY / "dual.gif")], check=True)
    sheet(folder).save(folder / "sheet.png")
    keep(folder / "sheet.png", GALLERY / "contact_sheet.png")


if __name__ == "__main__":
    main()
