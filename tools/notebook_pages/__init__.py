"""What `tools/notebooks` does: sources into notebooks, notebooks run, what they show into the documentation."""
