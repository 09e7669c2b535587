"""Independent answers that tests and tools judge the kernels by: readable twins of the steps, other solvers, Siconos."""
