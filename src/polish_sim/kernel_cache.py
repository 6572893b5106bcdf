"""`njit` and `cfunc` as numba has them, with a cache of the machine code that knows what a kernel calls.

Numba notices a change of the file a kernel stands in, not of the files it calls into: after an edit or an
update old machine code could keep running beside new. Here kernels are kept in one folder per user, in a
subfolder per module and state of its sources: the name holds a hash of the kernel's file, of every file of
this package it imports, directly or not, and of the compiler's versions. An edit therefore recompiles only
what depends on it, and several checkouts or versions share the folder without overwriting each other's
kernels.

A wheel may carry kernels (``make wheel``), compiled for a common CPU; they are read first and never written.

This is the only file that imports numba's and llvmlite's internals, and it refuses versions it was not tested
with.
"""

from __future__ import annotations

import atexit
import gc
import json
import logging
import os
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache, cached_property
from inspect import getclosurevars
from multiprocessing import parent_process
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any, NamedTuple

import llvmlite
import llvmlite.binding as llvm
import numba

from polish_sim.errors import PolishSimError
from polish_sim.row_file import lock
from polish_sim.source_stamp import source_stamp

#: Versions whose internals are used here: from the first on, before the second
NUMBA = ("0.61", "0.69")


def check_numba(version: str) -> None:
    """Refuse a version of numba whose internals are unknown here.

    Raises:
        PolishSimError: Naming the version, the range and the command that installs one of it.
    """
    low, here, high = (tuple(map(int, text.split(".")[:2])) for text in (NUMBA[0], version, NUMBA[1]))
    if not low <= here < high:
        raise PolishSimError(
            f"numba {version} is installed, polish-sim works with {NUMBA[0]} up to, not including, "
            f'{NUMBA[1]}: install one of these with: python -m pip install "numba>={NUMBA[0]},<{NUMBA[1]}"'
        )


check_numba(numba.__version__)

import numba.experimental.function_type  # registers functions as arguments of kernels
from numba.core import cgutils, environment, types
from numba.core import event as event  # used by the command line
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.ccallback import CFunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.lowering import Lower
from numba.core.registry import CPUDispatcher, cpu_target
from numba.core.runtime import _nrt_python
from numba.core.sigutils import normalize_signature
from numba.core.typed_passes import NativeLowering
from numba.core.types import Array, BaseFunction, Dispatcher, Integer, NestedArray
from numba.core.types.misc import unliteral
from numba.core.typing.arraydecl import RecordAttribute
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_getattr_generic,
    models,
    register_model,
    unbox,
)
from numba.misc.appdirs import user_cache_dir

SHIPPED = "kernels"  #: Folder of the package, of a wheel that carries its kernels
MADE_FOR = "made_for.json"  #: What they were compiled for
FOLDER = "POLISH_SIM_KERNELS"
"""Environment variable that names another folder than the user's; a worker process inherits a temporary one
by it."""

_PACKAGE = __name__.partition(".")[0]
_MOST_DAYS = 60  # since a subfolder was last used
_MOST_BYTES = 1 << 30
_DAY = 86400.0
_LONGEST_WAIT_S = 600.0  # for another process that compiles the same kernel
_log = logging.getLogger(__name__)


add_symbol = llvm.add_symbol  #: Name the address of a C function for kernels
for _name, _address in _nrt_python.c_helpers.items():
    add_symbol(f"NRT_{_name}", _address)  # the memory of arrays; numba names them when it compiles
_target = cpu_target.target_context
load_registries = cache(_target.load_additional_registries)  #: Load what compiling needs


def _refresh_registries() -> None:
    """Let the compiler see functions defined since it looked last; what defines numba's own is imported
    once, not with each function it meets."""
    load_registries()
    for registry in tuple(_target._registries):
        _target.install_registry(registry)


_target.load_additional_registries = _refresh_registries
# Numba notes the begin and the end of each call of LLVM, 100 000 in a first start; nobody here reads that.
llvm.ffi.lib._lock._cblist.clear()


_resolve: Any = BaseFunction.get_call_type


def _resolve_once(self: Any, context: Any, args: Any, named: Any) -> Any:
    """Types of a call of an operation of numba's own, found once for each kind of arguments.

    Numba tries each product of two numbers as one of arrays first, and so on: a tenth of a first start.
    """
    known = vars(self).setdefault("_known", {})
    given = *args, *named.items()
    if given in known:
        return known[given]
    found = _resolve(self, context, args, named)
    if self._impl_keys[found.args] == self.typing_key:  # not compiled for it, with the options of its caller
        known[given] = found
    return found


BaseFunction.get_call_type = _resolve_once  # type: ignore[assignment, method-assign]


def _resolve_field(_, record, name):  # type: ignore[no-untyped-def]
    """Type of a record's field; of an array as of any other: what takes both is compiled once."""
    field = record.typeof(name)
    return Array(field.dtype, field.ndim, "C") if isinstance(field, NestedArray) else field


RecordAttribute.generic_resolve = _resolve_field


# Numba imports the module of each function in the cache, many of its own that only compiling needs. Machine
# code does without.
environment.importlib = SimpleNamespace(import_module=lambda name: SimpleNamespace(__name__=name))


class _Lower(Lower):  # type: ignore[misc]
    """Numba's translation to LLVM with a fifth fewer lines, which all passes after it would read."""

    def delvar(self, name: str) -> None:
        """End of a variable: nothing where no references are counted."""
        if self.context.enable_nrt:
            super().delvar(name)

    def lower_getitem(self, wanted, given, array, index, signature):  # type: ignore[no-untyped-def]
        """What an index means; an element is loaded without a copy of the array's fields."""
        context, builder, found = self.context, self.builder, signature.return_type
        kind, places = self.typeof(array.name), self.typeof(index.name)
        at = [self.loadvar(index.name)]
        if isinstance(places, types.BaseTuple):  # type: ignore[attr-defined]
            at = cgutils.unpack_tuple(builder, *at)
        else:
            places = [places]
        plain = isinstance(kind, Array) and kind.aligned and not context.enable_boundscheck
        if not plain or isinstance(found, Array) or not all(isinstance(place, Integer) for place in places):
            return super().lower_getitem(wanted, given, array, index, signature)
        from numba.np.arrayobj import fix_integer_index  # slow to import

        fields = self.loadvar(array.name)
        data, sizes, strides = (builder.extract_value(fields, field) for field in (4, 5, 6))
        sizes, strides = (cgutils.unpack_tuple(builder, each) for each in (sizes, strides))
        at = [fix_integer_index(context, builder, *each) for each in zip(places, at, sizes, strict=True)]
        address = cgutils.get_item_pointer2(context, builder, data, sizes, strides, kind.layout, at)
        return context.cast(builder, context.unpack_value(builder, found, address), found, wanted)


NativeLowering.lowering_class = _Lower


def njit(function: Callable[..., Any] | None = None, *, cache: bool = True, **options: Any) -> Any:
    """Compile a function at its first call and keep the machine code; options as of ``numba.njit``.

    Without ``cache`` it is kept only within the kernels that call it. A division by zero gives infinity or
    nan, as in numpy. C callbacks are made of no kernel but by `cfunc`: wrappers for them are not compiled.
    """
    options = {"error_model": "numpy", "no_cfunc_wrapper": True, **options}

    def decorate(function: Callable[..., Any]) -> Any:
        if numba.config.DISABLE_JIT:
            return numba.njit(**options)(function)
        kind = _Kernel if cache else _Part
        targetoptions = {"nopython": True, "boundscheck": None, **options}
        return kind(function, targetoptions=targetoptions, pipeline_class=_Compiler)

    return decorate if function is None else decorate(function)


def cfunc(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Make a C callback of a function, compiled when its address is first needed, and keep the machine
    code."""

    def decorate(function: Callable[..., Any]) -> Any:
        return _Callback(function, normalize_signature(signature), locals={}, options={})

    return decorate


def is_warm() -> bool:
    """Whether the simulation's kernels, as the sources are now, have been compiled before."""
    folder, shipped = _kernel_folder(f"{_PACKAGE}.cell.loop"), _shipped()
    folders = [folder] if shipped is None else [folder, shipped.folder / folder.name]
    return any(any(folder.glob("loop.advance*.nbc")) for folder in folders)


def kernels_under(kernel: Any) -> set[Any]:
    """A kernel and all kernels it calls, directly or not, that are compiled on their own."""
    found = {kernel}
    waiting = [kernel]
    while waiting:
        enclosed, named, *_ = getclosurevars(waiting.pop().py_func)
        called = {value for value in {**enclosed, **named}.values() if isinstance(value, _Kernel)}
        waiting += called - found
        found |= called
    return {kernel for kernel in found if kernel.targetoptions.get("inline") != "always"}


class BundleType(types.Type):  # type: ignore[misc]
    """A `Bundle` in kernels: the address of its words of 8 bytes.

    Each field is what numba passes of it; ``fields``: type and first word by name.
    """

    def __init__(self, name: str, fields: dict[str, Any]) -> None:
        self.fields = fields
        super().__init__(f"{name}({fields})")

    @property
    def mangling_args(self) -> Any:
        """A short name within those of kernels."""
        return "Bundle", (self._code,)  # type: ignore[attr-defined]


register_model(BundleType)(models.OpaqueModel)


@infer_getattr
class _BundleFields(AttributeTemplate):  # type: ignore[misc]
    key = BundleType

    def generic_resolve(self, kind: Any, name: str) -> Any:
        return kind.fields.get(name, (None,))[0]


@lower_getattr_generic(BundleType)
def _load_field(context, builder, kind, address, name):  # type: ignore[no-untyped-def]
    field, word = kind.fields[name]
    form = context.get_value_type(field).as_pointer()
    return builder.load(cgutils.pointer_add(builder, address, 8 * word, form))


@unbox(BundleType)
def _unbox_bundle(_, bundle, c):  # type: ignore[no-untyped-def]
    address = c.pyapi.object_getattr_string(bundle, "address")
    value = c.pyapi.long_as_voidptr(address)
    c.pyapi.decref(address)
    return NativeValue(value, is_error=c.pyapi.c_api_error())


class _Locator:
    """Where numba finds the kernels of a module."""

    def __init__(self, function: Any, file: str) -> None:
        self._py_file = file  # numba's warnings name it
        self._line = function.__code__.co_firstlineno
        self.folder = _kernel_folder(function.__module__)

    @classmethod
    def from_function(cls, function: Any, file: str) -> _Locator:
        """The locator of a function."""
        return cls(function, file)

    def get_cache_path(self) -> str:
        """Folder of the kernel."""
        return str(self.folder)

    def get_source_stamp(self) -> str:
        """Nothing more to compare: the folder's name holds the hash of the sources."""
        return self.folder.name

    def get_disambiguator(self) -> str:
        """Distinguishes functions of the same name in one module."""
        return str(self._line)

    def ensure_cache_path(self) -> None:
        """Make the folder; numba calls this before it writes."""
        if not self.folder.exists():
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            _prune(self.folder.parent)


class _Implementation(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (_Locator,)


class KernelCache(FunctionCache):  # type: ignore[misc]
    """Machine code of one function: read from the wheel or from the user's folder, written to the latter.

    Processes that need the same kernel at the same time do not compile it twice: the others wait for the
    first.
    """

    _impl_class = _Implementation

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._lock = self._impl.locator.folder / f"{self._impl.filename_base}.lock"
        self._claim: IO[bytes] | None = None

    def load_overload(self, signature: Any, context: Any) -> Any:
        """A kept function, None if there is none.

        What compiling needs is loaded when something is compiled, not here as numba does: that takes 0.2 s.
        """
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, context)

    def _load_overload(self, signature: Any, context: Any) -> Any:
        """A compiled function, None if this process has to compile it."""
        result = self._load_carried(signature, context)
        if result is None:
            result = super()._load_overload(signature, context)
        if result is None and self._claim is None:
            self._wait_for_claim()
            result = super()._load_overload(signature, context)
        return result

    def _load_carried(self, signature: Any, context: Any) -> Any:
        shipped = _shipped()
        if shipped is None:
            return None
        name = self._lock.parent.name
        carried = IndexDataCacheFile(str(shipped.folder / name), self._impl.filename_base, name)
        given, _, code = self._index_key(signature, context.codegen())
        data = carried.load((given, shipped.machine, code))
        return None if data is None else self._impl.rebuild(context, data)

    def _save_overload(self, signature: Any, data: Any) -> None:
        """Keep a compiled function, if there is room for it."""
        try:
            super()._save_overload(signature, data)
        except OSError as error:
            _say(f"warning: compiled kernels cannot be kept in {_home()} ({error.strerror})")

    def _wait_for_claim(self) -> None:
        """Claim the function for this process, once no other one is compiling it."""
        with suppress(OSError):  # nothing can be written there: _save_overload says so
            self._impl.locator.ensure_cache_path()
            self._claim = open(self._lock, "wb")  # noqa: SIM115  (closed by `release`)
            latest = time.monotonic() + _LONGEST_WAIT_S
            # On Windows two processes may compile the same kernel.
            while not lock(self._claim.fileno()) and time.monotonic() < latest:
                time.sleep(0.02)

    def release(self) -> None:
        """Let other processes have the function; called when it is compiled or cannot be."""
        if self._claim is not None:
            with suppress(PermissionError):  # on Windows, where it is open
                self._lock.unlink(missing_ok=True)
            self._claim.close()
            self._claim = None


@contextmanager
def _collector_at_rest() -> Iterator[None]:
    """Collect no garbage while the block runs: it takes an eighth of the time of compiling. What compiling
    leaves, 80 MB in a first start, is not looked through later either."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.freeze()
            gc.enable()


def _in_one_chunk(work: Callable[..., Any], signature: Any) -> Any:
    """Call a function with room for the frames of all it calls.

    CPython keeps frames in chunks of 16 KB: each call that crosses the end of one maps memory and its return
    unmaps it, 350 000 times in a first start, which took 3 s. A frame of 512 KB comes with a chunk of 1 MB,
    half of it free.
    """
    return work(signature)


_in_one_chunk.__code__ = _in_one_chunk.__code__.replace(co_stacksize=1 << 16)


class _Compiler(Compiler):  # type: ignore[misc]
    """Numba's compiler without its passes for what no kernel has: functions within it, numba's functions put
    in the place of their calls, expressions of whole arrays in one loop."""

    def define_pipelines(self) -> Any:
        """Its passes, in their order."""
        (pipeline,) = super().define_pipelines()
        unused = "InlineClosureLikes", "InlineOverloads", "NopythonRewrites"
        pipeline.passes = [step for step in pipeline.passes if step[0].__name__ not in unused]
        return [pipeline]


class _Function(CPUDispatcher):  # type: ignore[misc]
    """A function of kernels. Integer literals are passed as plain integers; numba would specialise on
    each."""

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Types of a call from another kernel."""
        named = {name: unliteral(kind) for name, kind in kws.items()}
        return super().get_call_template([unliteral(kind) for kind in args], named)

    def _compilation_chain_init_hook(self) -> None:
        """What extends numba is looked for with all that compiling needs."""

    def compile(self, signature: Any) -> Any:
        """Entry point for a signature."""
        with _collector_at_rest():
            return _in_one_chunk(super().compile, signature)


class _PartLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code that only kernels call: linked into them, optimised and made machine code of there alone."""

    _final_module: Any

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        """Give the engine only the variables of environments, which numba sets and kernels refer to."""
        code = self._final_module
        held = [entry.name for entry in code.global_variables if "08NumbaEnv" in entry.name]
        self._final_module = llvm.parse_assembly(
            "".join(f'@"{name}" = common global i64 0\n' for name in held)
        )
        super()._finalize_final_module()
        self._final_module = code


def _part_compiler(typing: Any, target: Any, _: None, *rest: Any) -> Any:
    return _Compiler(typing, target, _PartLibrary(target.codegen(), "part"), *rest)


class _Part(_Function):
    """A function other kernels are made of: compiled for them without what Python needs to call it."""

    @cached_property
    def _bare(self) -> _Function:
        bare = {**self.targetoptions, "no_cpython_wrapper": True}
        return _Function(self.py_func, targetoptions=bare, pipeline_class=_part_compiler)

    @property
    def _numba_type_(self) -> Any:
        return Dispatcher(self._bare)


class _Kept:
    """What is taken from the cache, or compiled and kept there."""

    def __init__(self, function: Any, *arguments: Any, **options: Any) -> None:
        super().__init__(function, *arguments, **options)  # type: ignore[call-arg]
        self._cache = KernelCache(function)

    def compile(self, *signature: Any) -> Any:
        """Entry point for a signature, from the cache or compiled."""
        try:
            return super().compile(*signature)  # type: ignore[misc]
        finally:
            self._cache.release()


class _Kernel(_Kept, _Function):
    """A function compiled at its first call."""


class _Callback(_Kept, CFunc):  # type: ignore[misc]
    """A C callback, compiled when its address is first asked for."""

    _wrapper_address: int | None

    @property
    def address(self) -> int:
        """Address of the C function."""
        if self._wrapper_address is None:
            self.compile()
        assert self._wrapper_address is not None
        return self._wrapper_address


class _Shipped(NamedTuple):
    """Kernels that came with the package."""

    folder: Path
    machine: tuple[str, ...]  #: Platform, CPU and its features as numba's cache has them


@cache
def _shipped() -> _Shipped | None:
    """The kernels of the wheel, None where it has none or they do not fit this machine, which is then
    said."""
    folder = Path(__file__).with_name(SHIPPED)
    try:
        made_for = json.loads((folder / MADE_FOR).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    misfit = _misfit(made_for)
    if misfit is None:
        return _Shipped(folder, tuple(made_for["machine"]))
    _say(
        f"note: the kernels that came with polish-sim are {misfit}; others are compiled for this machine, "
        "once."
    )
    return None


def describe(features: Sequence[str]) -> None:
    """Print what `MADE_FOR` holds of kernels compiled by this process's settings.

    Args:
        features: CPU features they need, as LLVM names them.
    """
    machine = cpu_target.target_context.codegen().magic_tuple()
    print(json.dumps({"compiler": compiler(), "machine": machine, "features": features}, indent=2))


def _misfit(made_for: dict[str, Any]) -> str | None:
    """In what way shipped kernels do not fit this process."""
    if made_for["compiler"] != compiler():
        return f"for {made_for['compiler']}, here is {compiler()}"
    if made_for["machine"][0] != llvm.get_process_triple():
        return f"for {made_for['machine'][0]}, here is {llvm.get_process_triple()}"
    if numba.config.CPU_NAME not in (None, made_for["machine"][1]):
        return f"for the CPU {made_for['machine'][1]}, NUMBA_CPU_NAME asks for {numba.config.CPU_NAME}"
    missing = [name for name in made_for["features"] if not llvm.get_host_cpu_features().get(name)]
    return f"for a CPU with {', '.join(missing)}, which this one does not have" if missing else None


def _say(line: str) -> None:
    if parent_process() is None:  # workers find the same
        _log.warning(line)


@cache
def _kernel_folder(module: str) -> Path:
    """Folder of a module's kernels as the sources are now; marked as used."""
    folder = _home() / f"{module.removeprefix(f'{_PACKAGE}.')}-{source_stamp(module, compiler())}"
    with suppress(OSError):  # it does not exist yet, or is read-only
        if time.time() - folder.stat().st_mtime > _DAY:
            os.utime(folder)
    return folder


def compiler() -> str:
    """What machine code depends on beside the sources and the CPU."""
    version = ".".join(map(str, sys.version_info[:2]))
    return (
        f"numba {numba.__version__} with llvmlite {llvmlite.__version__} on {sys.implementation.name} "
        f"{version}"
    )


@cache
def _home() -> Path:
    """The folder of all kernels: the user's own and closed to others, for cached kernels are executable
    code."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    usual = Path(Path.home(), user_cache_dir("polish-sim", False, opinion=False), "kernels")  # home: if empty
    own = Path(chosen, _PACKAGE) if chosen else usual
    folder = Path(os.environ.get(FOLDER) or own)
    trouble = _trouble(folder)
    if trouble is None:
        return folder
    temporary = Path(tempfile.mkdtemp(prefix="polish-sim-kernels-"))
    os.environ[FOLDER] = str(temporary)
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    _log.warning("warning: compiled kernels are not kept: %s. Every start compiles them again.", trouble)
    return temporary


def _trouble(folder: Path) -> str | None:
    """Why kernels cannot be kept in a folder; it is made if it does not exist."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = folder.stat()
    except OSError as error:
        return f"{folder} cannot be made ({error.strerror})"
    if hasattr(os, "getuid"):
        if state.st_uid != os.getuid():
            return (
                f"{folder} belongs to another user; delete it or set NUMBA_CACHE_DIR to a folder of your own"
            )
        if state.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            return f"others can write to {folder} (chmod go-w would close it)"
    return None if os.access(folder, os.W_OK) else f"{folder} is read-only"


@cache
def _prune(home: Path) -> None:
    """Delete subfolders long unused, and beyond the size kept the ones unused longest; once per process."""
    now = time.time()
    total = 0
    for used, folder in sorted(_folders(home), reverse=True):
        total += sum(file.stat().st_size for file in folder.glob("*.nb?"))
        if now - used > _MOST_DAYS * _DAY or total > _MOST_BYTES:
            shutil.rmtree(folder, ignore_errors=True)


def _folders(home: Path) -> Iterator[tuple[float, Path]]:
    for folder in home.iterdir():
        with suppress(FileNotFoundError):  # another process has just deleted it
            yield folder.stat().st_mtime, folder
