"""Notes whose contact is known, for tools/contact-table and tests/fit."""
