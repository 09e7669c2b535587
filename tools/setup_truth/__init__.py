"""Thresholds of touch and buzz found by runs of `synth.simulate` alone, for tools/setup-truth and tests/setup."""
