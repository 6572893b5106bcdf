"""A job's file and its tool library: what they say, and that what is wrong is refused with its line."""

import math
import random
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.integrate import quad

from polish_sim.cell.dwell import exposure_rates
from polish_sim.config import PartConfig
from polish_sim.errors import PolishSimError
from polish_sim.experiments.registry import default_scenario
from polish_sim.job.job_file import begin_job, read_job
from polish_sim.job.run_job import check_regions
from polish_sim.job.tools import ORBITAL, JobTool, read_tools
from polish_sim.scenario_file import merge
from tests.cell.test_removal import FORCE, STIFFNESS, R, level_nodes, pressed_at

TEXT = begin_job(PartConfig("plate"), Path("job.toml"))


def read(folder, text):
    file = folder / "job.toml"
    file.write_text(text, encoding="utf-8")
    return read_job(file)


def test_the_template_is_two_crossed_passes_and_passes_are_setups_times_regions_times_passes(tmp_path):
    one, other = read(tmp_path, TEXT).passes
    assert (one.head.grit, other.head.grit) == (120, 240)
    assert one.scenario.plan.raster_direction == (1.0, 0.0, 0.0)
    assert one.scenario.robot.arm == "ur5e"
    assert other.scenario.process.contact_force_n == 15.0
    trimesh.creation.box((30.0, 15.0, 22.0)).export(tmp_path / "block.stl")  # its largest faces look along y
    small = read(tmp_path, begin_job(PartConfig(str(tmp_path / "block.stl")), tmp_path / "job.toml")).passes
    assert [step.scenario.pad.radius_m for step in small] == [0.01, 0.01]
    assert [step.scenario.plan.raster_direction for step in small] == [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0)]
    text = TEXT.replace('regions = ["auto"]', 'regions = ["top", "auto"]')
    folders = [one.folder for one in read(tmp_path, text + "\n[[setup]]\n[[setup.pass]]\n").passes]
    crossed = [f"setup_1/region_{region}/pass_{number}" for region in (1, 2) for number in (1, 2)]
    assert folders == [*crossed, "setup_2/region_1/pass_1"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("grit = 120", "grti = 120"), ('regions = ["auto"]', 'regions = "auto"'),
        ("process.contact_force_n = 15.0", "process.contact_force_n = -15.0"),
        ("process.contact_force_n = 15.0", "process.contact_force_n = 55.0"),
        ('tool = "spindle-pad"  #', 'tool = "spindel-pad"  #'),
        ('plan.pattern = "raster"\n', 'plan.pattern = "rastre"\n'),
        ("clamp_s = 60.0", "clamp_s = 'long'"), ('robot.arm = "ur5e"', 'robot.arn = "ur5e"'),
        ('robot.arm = "ur5e"', 'part.up = "x"'), ('plan.pattern = "raster"\n', 'plan.region = "top"\n'),
    ],
)  # fmt: skip
def test_what_is_wrong_is_refused_with_its_line(tmp_path, old, new):
    text = TEXT.replace(old, new, 1)
    (changed,) = [n for n, line in enumerate(text.splitlines(), 1) if line not in TEXT.splitlines()]
    with pytest.raises(PolishSimError, match=rf"line {changed}\b"):
        read(tmp_path, text)
    with pytest.raises(PolishSimError, match="Did you mean 'pass'"):
        read(tmp_path, TEXT.replace("setup.pass", "setup.pas"))


def test_mutated_files_are_read_or_refused_with_one_error(tmp_path):
    rng = random.Random(500)
    refused = list[str]()
    for _ in range(60):
        text = list(TEXT)
        for _ in range(rng.randint(1, 4)):
            at = rng.randrange(len(text))
            text[at : at + rng.randint(0, 3)] = rng.choice(["", "x", "=", "[", "-1", '"', "\n", "9e99"])
        try:
            read(tmp_path, "".join(text))
        except PolishSimError as error:
            refused.append(str(error))
    assert len(refused) > 10
    assert [error for error in refused if not re.search(r"line \d+", error)] == []
    assert [file.name for file in tmp_path.iterdir()] == ["job.toml"]


def test_files_are_named_from_the_jobs_folder_and_errors_in_them_with_their_line(tmp_path):
    (tmp_path / "corner.txt").write_text("0,0,0\n40,0,0\n40,40,0\n")
    zone = '[[setup.pass.zone]]\nregion = "polygon:corner.txt"\n'
    text = TEXT.replace('regions = ["auto"]', 'regions = ["polygon:corner.txt"]') + zone
    one = read(tmp_path, text).passes[-1]
    assert one.zones[0].region == one.scenario.plan.region == f"polygon:{tmp_path / 'corner.txt'}"
    text = TEXT + '[[setup.pass.zone]]\nregion = "faces:missing.txt"\n'
    with pytest.raises(PolishSimError, match=f"line {len(text.splitlines())}: "):
        check_regions(read(tmp_path, text))
    (tmp_path / "mine.toml").write_text("[a]\nspeed_rpm = 1000.0\n[b]\nspeed_rpm = -1.0\n")
    with pytest.raises(PolishSimError, match=r"mine.toml, line 4: 'b.speed_rpm'"):
        read(tmp_path, f'tools = "mine.toml"\n{TEXT}')


def test_every_shipped_tool_is_a_scenario_an_orbit_takes_off_evenly_and_a_worn_abrasive_half():
    usual = default_scenario("surface")
    scenarios = {name: merge(usual, tool.settings(), "") for name, tool in read_tools().items()}
    assert all(scenarios[name].pad.radius_m == tool.radius_m for name, tool in read_tools().items())
    assert (scenarios["spindle-pad"].head, scenarios["spindle-pad"].spindle) == (usual.head, usual.spindle)
    # On a plane p = F / (pi R^2) everywhere, and |u + w t(phi)| over the orbit is w for a slow feed u.
    tool = JobTool(kind=ORBITAL, orbit_m=0.0025, speed_rpm=10000.0)
    slide, feed = tool.slide_m_s, 0.05
    round_ = quad(lambda phi: math.hypot(feed + slide * math.cos(phi), slide * math.sin(phi)), 0.0, math.tau)
    exact = round_[0] / math.tau
    nodes = level_nodes(0.001)
    pose = pressed_at(0.0)._replace(velocities=np.array([[feed, 0.0, 0.0]]), turning=np.zeros((1, 3)))
    found = exposure_rates(nodes, pose, R, STIFFNESS, slide).rates.toarray()[0]
    under = np.linalg.norm(nodes.positions[:, :2], axis=1) < 0.98 * R
    np.testing.assert_allclose(found[under], FORCE / (math.pi * R**2) * exact, rtol=0.02)
    assert [JobTool(wear_nm=1000.0).left(work) for work in (0.0, 1000.0)] == pytest.approx([1.0, 0.5])
    assert JobTool().left(1e9) == 1.0


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[a]\nradius_m = -1.0\n", "radius_m"), ("[a]\nkind = 'laser'\n", "laser"),
        ("[a]\nkind = 'orbital'\n", "orbit_m"), ("[a]\nspeed_rpm = 20000.0\n", "speed_rpm"),
        ("a = 3\n", "a"), ("[a\n", "TOML"),
    ],
)  # fmt: skip
def test_a_bad_tool_is_refused_by_name(tmp_path, text, named):
    file = tmp_path / "tools.toml"
    file.write_text(text)
    with pytest.raises(PolishSimError, match=named):
        read_tools(file)
