"""Keep compiled kernels in the folder of this exact version, and let Ctrl-C be Ctrl-C wherever the tests run."""

import os
import signal

from polish_sim.kernel_cache import use_kernel_cache

# Before anything imports the compiler or numpy: on matrices this small, threads of the linear algebra only wait for
# each other, fifty times as long as the work takes.
use_kernel_cache()
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A shell starts background jobs with SIGINT ignored, and so would every process the tests start: they test Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)
