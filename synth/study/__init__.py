"""Studies: many runs of a case, a note or a function, on one machine or many, each computed once.

values        lists, ranges and random draws of a parameter
studyfile     a study's tables, read and checked
design        the rows that a study asks for, one after the other, never all at once
work          what a worker does: bases, measures, a batch of rows. Its sources are part of every row's address
addressing    a row's address: the hash of all that its numbers depend on
keeping       the folder: journal, Parquet parts, references, arrays, the lock
compacting    the finished table, in the order of the study
conducting    rows to workers and back, in bounded number; killed workers, killed schedulers
clusters      where the workers are: processes of this machine (`synth.workers`), a cluster of Dask's, or this process
remote        a scheduler at an address: encryption, certificates
sweeping      `sweep`: a study from its file to its table
showing       progress, status
drawing       families of curves, Pareto fronts
"""
