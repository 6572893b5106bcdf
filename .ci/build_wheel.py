"""Build a wheel that carries its compiled kernels: ``python .ci/build_wheel.py [FOLDER]``, or ``make wheel``.

The commands in `COMMANDS` run on the unpacked plain wheel and fill its folder of kernels, compiled for a CPU
that most machines surpass. The wheel is then tagged for this Python and platform and asks for the numba that
compiled it.
"""

from __future__ import annotations

import base64
import hashlib
import os
import platform
import subprocess
import sys
import sysconfig
import tempfile
import time
import zipfile
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BASELINES = {
    "x86_64": ("x86-64-v3", "sse3 ssse3 sse4.1 sse4.2 popcnt avx avx2 bmi bmi2 f16c fma lzcnt movbe"),
}
"""CPU that kernels are compiled for, and the features a machine must have to run them; elsewhere a generic
one."""
COMMANDS = (
    "demo",
    "run arc",
    *(f"run force --controller {name}" for name in ("hybrid-pi", "hybrid-adaptive")),
    *(f"run force --controller {name}" for name in ("hybrid-pi-position", "force-mode")),
    "run surface --part plate --pattern raster --stepover 25 --feed 60 --controller hybrid-adaptive",
    *(f"plan freeform --stepover 12 --pattern {name}" for name in ("spiral", "raster", "contour", "fermat")),
    *(
        f"plan {part} --stepover 12"
        for part in ("plate_two_holes", "cylinder", "sphere_100", "wheel_hub_rim")
    ),
    "plan wheel_hub_rim --dual",
    "run dual --feed 60",
    "run teach",
    "run smooth",
    "smooth 0/path.csv",
    "inspect 0/path.csv",
    "identify --periods 1",
    "calibrate payload",
    "score --case step-20 --seeds 1 --workers 1",
)
"""What fills the wheel: these compile nothing in a fresh installation. Each has its number as output
folder."""


def build(target: Path) -> Path:
    """Build the wheel into a folder; return its file."""
    with tempfile.TemporaryDirectory() as work:
        plain, unpacked = Path(work, "plain"), Path(work, "unpacked")
        pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-deps"]
        subprocess.run([*pip, "--wheel-dir", str(plain), str(ROOT)], check=True)
        with zipfile.ZipFile(next(plain.glob("*.whl"))) as archive:
            archive.extractall(unpacked)
        fill(unpacked)
        return pack(unpacked, target)


def fill(unpacked: Path) -> None:
    """Run the commands on an unpacked wheel so that their kernels are compiled into it."""
    kernels = unpacked / "polish_sim" / "kernels"
    cpu, features = BASELINES.get(platform.machine(), ("generic", ""))
    environment = os.environ | {
        "PYTHONPATH": str(unpacked),
        "POLISH_SIM_KERNELS": str(kernels),
        "NUMBA_CPU_NAME": cpu,
        "NUMBA_CPU_FEATURES": "",
    }
    app = [sys.executable, "-c", "from polish_sim.cli.main import app; app()"]
    with tempfile.TemporaryDirectory() as work:
        for number, command in enumerate(COMMANDS):
            begin, before = time.perf_counter(), _count(kernels)
            words = [*app, *command.split(), "--out", str(number)]
            done = subprocess.run(words, env=environment, cwd=work, capture_output=True, text=True)
            if done.returncode:
                sys.exit(f"polish-sim {command}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
            figures = f"{_count(kernels) - before} kernels, {time.perf_counter() - begin:.0f} s"
            print(f"{number + 1}/{len(COMMANDS)} {command}: {figures}", flush=True)
    for file in [*kernels.rglob("*.lock"), *kernels.rglob("*.tmp.*")]:  # of processes that were ended
        file.unlink()
    describe = f"from polish_sim.kernel_cache import describe; describe({features.split()})"
    made_for = subprocess.run(
        [sys.executable, "-c", describe], env=environment, capture_output=True, check=True
    )
    (kernels / "made_for.json").write_bytes(made_for.stdout)


def _count(kernels: Path) -> int:
    return len(list(kernels.rglob("*.nbc")))


def pack(unpacked: Path, target: Path) -> Path:
    """Pin numba, tag the wheel for this Python and platform, and write it."""
    info = next(unpacked.glob("*.dist-info"))
    metadata = (info / "METADATA").read_text(encoding="utf-8").splitlines(keepends=True)
    pinned = [f"Requires-Dist: {name}=={version(name)}\n" for name in ("numba", "llvmlite")]
    first = next(k for k, line in enumerate(metadata) if line.startswith("Requires-Dist: numba"))
    metadata[first : first + 1] = pinned
    (info / "METADATA").write_text("".join(metadata), encoding="utf-8")
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    tag = f"{python}-{python}-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"
    wheel = f"Wheel-Version: 1.0\nGenerator: .ci/build_wheel.py\nRoot-Is-Purelib: false\nTag: {tag}\n"
    (info / "WHEEL").write_text(wheel, encoding="utf-8")
    record = info / "RECORD"
    record.unlink()
    files = sorted(file for file in unpacked.rglob("*") if file.is_file())
    lines = [_record(file.relative_to(unpacked).as_posix(), file.read_bytes()) for file in files]
    record.write_text("".join([*lines, f"{record.relative_to(unpacked).as_posix()},,\n"]), encoding="utf-8")
    target.mkdir(parents=True, exist_ok=True)
    built = target / f"{info.name.removesuffix('.dist-info')}-{tag}.whl"
    with zipfile.ZipFile(built, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in [*files, record]:
            archive.write(file, file.relative_to(unpacked))
    return built


def _record(name: str, content: bytes) -> str:
    digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
    return f"{name},sha256={digest},{len(content)}\n"


if __name__ == "__main__":
    wheel = build(Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "dist"))
    print(f"{wheel}: {wheel.stat().st_size / 1e6:.1f} MB")
