"""`simulate` of strings that share a bridge and a body.

coupled_case     the tables of a case
coupled_scene    its strings, obstacles and body as arrays; what a bend or a fret makes of a string
coupled_run      the run by the kernels of `solver.frames`
complex_modes    the exact run of what touches nothing
coupled_result   what comes out
"""
