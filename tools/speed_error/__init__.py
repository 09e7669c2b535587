"""What `tools/speed-error` does: runs of every scheme, their errors and their cost, tables and pictures."""
