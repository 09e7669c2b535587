"""What is fitted on some dynamics of a fretted note predicts of the others: the parts of tools/fit-recordings."""
