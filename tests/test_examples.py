"""The numbered examples run as they stand and print what they promise."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

FOLDER = Path(__file__).resolve().parent.parent / "examples"
PRINTS = {
    "01_load_part": r"wedge: 8 facets, up \[0\. 0\. 1\.\]",
    "02_fit_surface": r"normal error: 0\.00\d\d deg at most",
    "03_select_region": r"auto, 10 mm off the edges +\d+\.\d cm2, 3 borders",
    "04_plan_spiral": r"coverage_stepover +(1|0\.99\d*)\n",
    "05_compare_patterns": r"spiral .*\ncontour .*\nfermat .*\nraster ",
    "06_inspect_path": r"stepover_mean_m +0\.0060",
    "07_export": r"APT read back: [45]\.\de-10 m off",
    "08_run_surface": r"contact force: 1[45]\.\d\d N on average, 15 N asked for",
}


@pytest.mark.parametrize("name", PRINTS)
def test_the_example_runs_and_prints_what_it_promises(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
    plt.close("all")
    assert re.search(PRINTS[name], capsys.readouterr().out)


def test_every_example_is_run_listed_and_named_in_order() -> None:
    names = sorted(file.stem for file in FOLDER.glob("*.py"))
    assert names == sorted(PRINTS)
    assert re.findall(r"^\| \[(\w+)\.py\]", (FOLDER / "README.md").read_text(encoding="utf-8"), re.MULTILINE) == names
    assert [int(name[:2]) for name in names] == list(range(1, len(names) + 1))
