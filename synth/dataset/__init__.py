"""Data sets of physically labelled sound: a recipe → FLAC in tar shards, an index in Parquet, labels in Zarr.

`recipefile`, `recipecheck` (what is wanted), `alternatives` (lists, ranges, draws), `items` (each from its number alone),
`splits`; `soloist` and `labelled` (an item's sound, with the motion that made it), `packing` (FLAC and measures);
`shardfile`, `itemrows`, `labelstore`, `setfolder` (what lies where); `crew`, `filling` (workers; from where it was left),
`verifying`, `datacard`, `forecast`.
"""
