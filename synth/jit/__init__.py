"""How kernels come to be compiled, kept and found again.

kernel_cache     where compiled kernels are kept between runs
kernel_claims    which process compiles what
kernel_helpers   several processes that compile
kernel_linking   large kernels are called, not copied
compiling        what is being compiled, and how much is still to come
"""
