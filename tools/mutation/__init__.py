"""Mutation testing: what is mutated and tested by what (`table`), which mutants (`sample`), what becomes of each (`trial`),
and what is told of them (`run`)."""
