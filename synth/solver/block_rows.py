"""Rows of a block's coefficient array, as `responses.fill_rows` makes them: of one step p11, p12, p21, p22, kq, kv (`laws`),
its trace a and −e, e its determinant; of a block Φ^K; (Φ − a)κ."""

from __future__ import annotations

#: steps that a block kernel takes at a time
BLOCK = 8
ROWS = 14
P11, P12, P21, P22, KQ, KV, TRACE, MINUS_DET, ADV11, ADV12, ADV21, ADV22, KQ_LATE, KV_LATE = range(ROWS)
