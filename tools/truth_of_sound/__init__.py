"""What `tools/truth` does: measures of recorded and rendered notes, ranges, judgement, tables and pictures."""
