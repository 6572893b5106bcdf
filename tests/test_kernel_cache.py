"""Compiled kernels are kept, shared, shipped and refused as documented."""

import ast
import json
import logging
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from contextlib import ExitStack
from pathlib import Path

import pytest

from polish_sim import errors, kernel_cache, source_stamp
from tests.cli.conftest import Started

IMPORTS = "{imports}\nfrom polish_sim.kernel_cache import njit\n"
KERNEL = f"{IMPORTS}@njit(cache=True)\ndef {{name}}(x):\n    return {{value}}\n"
SCRIPT = """
import sys
from numba.core import event
compiled = event.RecordingListener()
event.register("numba:compile", compiled)
from polish_sim.stiffness import force
from polish_sim.damping import drag
print(force(2.0), drag(2.0), sum(e.is_start for _, e in compiled.buffer))
"""
DESCRIBE = "from polish_sim.kernel_cache import describe; describe([])"


@pytest.fixture
def package(tmp_path):
    """A package of this one's name with three kernels: `force` calls `gain`, `drag` stands alone."""
    folder = tmp_path / "code" / "polish_sim"
    folder.mkdir(parents=True)
    (folder / "__init__.py").touch()
    for module in (errors, kernel_cache, source_stamp):
        shutil.copy(module.__file__, folder)
    _write_gain(folder, 10.0)
    imports = "from polish_sim.gains import (\n    gain,\n)\n"
    (folder / "stiffness.py").write_text(KERNEL.format(imports=imports, name="force", value="gain(x) * x"))
    (folder / "damping.py").write_text(KERNEL.format(imports="", name="drag", value="-x"))
    return folder


def _write_gain(package, value):
    (package / "gains.py").write_text(KERNEL.format(imports="", name="gain", value=f"{value} + 0.0 * x"))


def _run(package, script=SCRIPT, **environment):
    """Numbers a script prints in a process that has nothing of this package yet, and its stderr."""
    (run,) = _runs(package, script, 1, **environment)
    return run


def _runs(package, script, count, **environment):
    """The same of ``count`` processes at once; they are forked, so that numba is not imported anew."""

    def begin():
        for name in [name for name in sys.modules if name.partition(".")[0] == "polish_sim"]:
            del sys.modules[name]
        os.environ.clear()
        os.environ.update(_environment(package) | environment)
        sys.path.insert(0, str(package.parent))
        sys.dont_write_bytecode = True  # as the environment says to those started anew
        logging.root.handlers.clear()  # those of pytest
        exec(script, {})
        sys.stdout.flush()
        os._exit(0)

    with ExitStack() as files:
        said = [[files.enter_context(tempfile.TemporaryFile("w+")) for _ in "oe"] for _ in range(count)]
        places = [{"out": out.fileno(), "err": err.fileno()} for out, err in said]
        for run in [Started(folder=package.parent, begin=begin, **place) for place in places]:
            run.wait()
        texts = [[(file.seek(0), file.read())[1] for file in both] for both in said]
    return [([float(word) for word in out.split()], err) for out, err in texts]


def _environment(package):
    kept = {k: v for k, v in os.environ.items() if k not in {"NUMBA_CACHE_DIR", "POLISH_SIM_KERNELS"}}
    kept["PYTHONDONTWRITEBYTECODE"] = "1"  # a file edited within a second would be taken from it
    return kept | {"PYTHONPATH": str(package.parent), "XDG_CACHE_HOME": str(package.parents[1] / "cache")}


def _cache(package):
    return package.parents[1] / "cache" / "polish-sim" / "kernels"


def test_only_dependents_of_an_edited_file_compile_again(package):
    long_unused = _cache(package) / "stiffness-of-last-year"
    long_unused.mkdir(parents=True)
    _cache(package).chmod(0o700)
    os.utime(long_unused, (0.0, 0.0))
    assert _run(package)[0] == [20.0, -2.0, 3]
    assert len(list(_cache(package).iterdir())) == 3
    assert not long_unused.exists()
    assert _run(package)[0] == [20.0, -2.0, 0]
    _write_gain(package, 30.0)
    assert _run(package)[0] == [60.0, -2.0, 2]
    _write_gain(package, 10.0)
    assert _run(package)[0] == [20.0, -2.0, 0]


def test_a_part_of_kernels_compiles_once_for_all_numbers_and_can_be_called_from_python(package):
    body = "    if x < 0.0:\n        raise ValueError(x)\n    return n * x\n"
    part = f"@njit(cache=False)\ndef part(x, n):\n{body}"
    three = KERNEL.format(imports="", name="three", value="part(x, 1) + part(x, 2)")
    (package / "sums.py").write_text(f"from polish_sim.kernel_cache import njit\n{part}{three}")
    count = "sum(e.is_start for _, e in compiled.buffer)"
    script = SCRIPT.replace("stiffness import force", "sums import three")
    script = script.replace("damping import drag", "sums import part")
    script = script.replace("force(2.0), drag(2.0)", f"three(2.0), {count}, part(2.0, 4)")
    script += "try:\n    three(-2.0)\nexcept ValueError as error:\n    print(*error.args)"
    assert _run(package, script)[0] == [6.0, 2, 8.0, 3, -2.0]
    assert _run(package, script)[0] == [6.0, 0, 8.0, 1, -2.0]  # from the cache


def test_kernels_of_other_packages_stay_where_numba_keeps_them(package):
    own = package.parent / "own.py"
    kernel = KERNEL.format(imports="from polish_sim.gains import gain", name="mine", value="gain(x)")
    own.write_text(kernel.replace("polish_sim.kernel_cache", "numba"))
    script = """
from own import mine
from polish_sim.kernel_cache import kernels_under
from polish_sim.stiffness import force
print(len(kernels_under(force)), len(kernels_under(force) & {force}))
mine(1.0)
"""
    assert _run(package, script)[0] == [2, 1]
    assert list(own.parent.glob("__pycache__/own.mine*.nbc"))
    assert not list(_cache(package).glob("*/own*"))


@pytest.mark.skipif(os.name == "nt", reason="folders of a Windows profile are closed to others")
def test_a_folder_of_ones_own_is_closed_to_others_one_they_can_write_to_refused_a_chosen_one_used(package):
    chosen = package.parent / "chosen"
    _run(package, NUMBA_CACHE_DIR=str(chosen))
    assert len(list(chosen.rglob("*.nbc"))) == 3
    assert not _cache(package).exists()
    _run(package, "from polish_sim.damping import drag; drag(2.0)")
    assert _cache(package).stat().st_mode & 0o777 == 0o700
    _cache(package).chmod(0o777)
    numbers, said = _run(package)
    assert numbers == [20.0, -2.0, 3]
    assert said.count("\n") == 1
    assert f"others can write to {_cache(package)}" in said


@pytest.mark.skipif(os.name == "nt", reason="file locks of POSIX")
def test_processes_share_the_compiling_of_kernels_and_a_killed_one_leaves_its_to_others(package):
    runs = [numbers for numbers, _ in _runs(package, SCRIPT, 3)]
    assert [run[:2] for run in runs] == [[20.0, -2.0]] * 3
    assert sum(run[2] for run in runs) == 3
    shutil.rmtree(_cache(package))
    claim = "from polish_sim.gains import gain; gain._cache._wait_for_claim(); print(1, flush=True)"
    command = [sys.executable, "-c", f"import time; {claim}; time.sleep(60)"]
    with subprocess.Popen(command, env=_environment(package), stdout=subprocess.PIPE) as claimant:
        claimant.stdout.readline()
        assert list(_cache(package).glob("*/gains.gain*.lock"))
        claimant.kill()
    assert _run(package)[0] == [20.0, -2.0, 3]
    assert not list(_cache(package).glob("*/*.lock"))


def test_kernels_of_a_wheel_are_used_but_for_another_machine(package, tmp_path, monkeypatch):
    # Kernels compiled for a common CPU inside the package, which is then put elsewhere.
    for_all = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    environment = for_all | {"POLISH_SIM_KERNELS": str(package / kernel_cache.SHIPPED)}
    command = [sys.executable, "-c", SCRIPT + DESCRIBE]  # numba asks for the CPU once
    run = subprocess.run(command, env=_environment(package) | environment, capture_output=True, check=True)
    (package / kernel_cache.SHIPPED / kernel_cache.MADE_FOR).write_bytes(run.stdout.partition(b"\n")[2])
    shipped = shutil.copytree(package, tmp_path / "installed elsewhere" / "code" / package.name)
    assert _run(shipped) == ([20.0, -2.0, 0], "")
    assert not any(_cache(shipped).iterdir())
    _write_gain(shipped, 30.0)
    assert _run(shipped)[0] == [60.0, -2.0, 2]
    assert _run(shipped)[0] == [60.0, -2.0, 0]
    assert {folder.name.partition("-")[0] for folder in _cache(shipped).iterdir()} == {"gains", "stiffness"}
    shipped = shutil.copytree(package, tmp_path / "on another machine" / "code" / package.name)
    file = shipped / kernel_cache.SHIPPED / kernel_cache.MADE_FOR
    made_for = json.loads(file.read_text())
    assert kernel_cache._misfit(made_for) is None
    for change, complaint in (
        ({"compiler": "numba 0.1 with llvmlite 0.1 on cpython 3.11"}, "for numba 0.1 with"),
        ({"machine": ["riscv64-unknown-linux-gnu", "generic", ""]}, "for riscv64"),
        ({"features": ["avx4096"]}, missing := "avx4096, which this one does not have"),
    ):
        assert complaint in str(kernel_cache._misfit(made_for | change))
    with monkeypatch.context() as asked:
        asked.setattr("numba.config.CPU_NAME", "x86-64")
        assert "NUMBA_CPU_NAME asks for x86-64" in str(kernel_cache._misfit(made_for))
    file.write_text(json.dumps(made_for | change))
    numbers, said = _run(shipped)
    assert numbers == [20.0, -2.0, 3]
    assert said.count("\n") == 1
    assert missing in said


def test_a_numba_that_was_not_tested_is_refused_and_one_file_uses_what_it_does_not_promise_to_keep(package):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert "numba>={},<{}".format(*kernel_cache.NUMBA) in project["dependencies"]
    (package.parent / "numba").mkdir()
    (package.parent / "numba" / "__init__.py").write_text("__version__ = '0.69.0rc1'")
    command = [sys.executable, "-c", "import polish_sim.kernel_cache"]
    run = subprocess.run(command, env=_environment(package), capture_output=True, text=True, check=False)
    assert run.returncode == 1
    for fact in ("PolishSimError", "numba 0.69.0rc1", *kernel_cache.NUMBA, "pip install"):
        assert fact in run.stderr.strip().splitlines()[-1]
    for version in ("0.61.0", "0.68.1"):
        kernel_cache.check_numba(version)
    for version in ("0.60.9", "1.0"):
        with pytest.raises(errors.PolishSimError):
            kernel_cache.check_numba(version)
    # Numba's own cache would not notice an edit of a callee in another file.
    internals = r"^\s*(from|import) (numba\.|llvmlite)|^from numba import .*\b(njit|cfunc)\b"
    files = [file for folder in ("src", "cli", "models") for file in (ROOT / folder).rglob("*.py")]
    users = {file.name for file in files if re.search(internals, file.read_text("utf-8"), re.MULTILINE)}
    assert users == {"kernel_cache.py"}


def test_every_import_at_the_top_of_a_module_is_found_and_the_simulations_kernels_once_compiled():
    """Against the parser: a missed import would leave stale machine code running."""
    for file in (ROOT / "src" / "polish_sim").rglob("*.py"):
        module = ".".join(file.relative_to(ROOT / "src").with_suffix("").parts).removesuffix(".__init__")
        named = set()
        nodes = ast.parse(file.read_text("utf-8")).body
        if "names_on_use(" in file.read_text("utf-8") and file.name == "__init__.py":
            nodes += [inner for node in nodes if isinstance(node, ast.If) for inner in node.body]
        for node in nodes:
            if isinstance(node, ast.ImportFrom):
                assert not node.level, f"{file}: relative imports are not followed"
                named |= {node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)}
            elif isinstance(node, ast.Import):
                named |= {alias.name for alias in node.names}
        ours = {name for name in named if name.split(".")[0] == "polish_sim"}
        files = {name for name in ours if source_stamp.source_file(name)}
        assert files == source_stamp.imports_of(module), file
    # What the command asks before it compiles ahead; the loop's name is written there.
    from polish_sim.cell import loop

    assert kernel_cache._kernel_folder(loop.__name__) == loop.advance._cache._impl.locator.folder
    assert loop.advance._cache._impl.filename_base.startswith("loop.advance")


ROOT = Path(__file__).parents[1]
BARE = "no_cpython_wrapper"


def _kernels(tree):
    """Compiled functions with the text of their decorators."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            decorators = " ".join(map(ast.unparse, node.decorator_list))
            if re.match(r"(njit|cfunc)\b", decorators):
                yield node, decorators


def test_no_kernel_gives_up_its_python_wrapper():
    """Called from Python it would crash the interpreter."""
    folders = ("src", "cli", "models", "tests", "benchmarks", "examples")
    texts = [file.read_text("utf-8") for folder in folders for file in (ROOT / folder).rglob("*.py")]
    kernels = [kernel for text in texts if "njit" in text for kernel in _kernels(ast.parse(text))]
    assert len(kernels) > 50
    assert not [kernel.name for kernel, decorators in kernels if BARE in decorators]
