"""The version of the program and the day of its release: here and nowhere else. What must repeat them (CITATION.cff, the
newest entry of CHANGELOG.md) is compared with this by a test."""

__version__ = "0.29.0"
#: year-month-day
DATE = "2026-11-30"
