"""Keep compiled kernels in the folder of this exact version, before anything imports the compiler."""

from polish_sim.kernel_cache import use_kernel_cache

use_kernel_cache()
