"""One string over one obstacle as a question to the solver: cases, schemes, results.

case         what is asked: read from a file or a preset, checked
case_words   what its keys mean
scene        the same as arrays
methods      how each scheme runs a scene
exact        solutions in a closed form, to judge schemes by
simulation   `simulate`: a case run, stopped, gone on with
result       what came out, read and written
"""
