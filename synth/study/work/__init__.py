"""What a worker of a study does: bases, measures, batches of rows. All that decides on a row's numbers is here or below.

bases      what is run: a case, a note of a preset, a function
taken      what a run gave, as measures see it
measuring  measures by name
running    a batch of rows, with what fails in its place
"""
