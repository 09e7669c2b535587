"""What `tools/sweep-check` measures of studies: what kills leave behind, what a row costs, memory, many workers."""
