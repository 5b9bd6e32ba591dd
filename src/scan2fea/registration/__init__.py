"""registration (see docs/design.md)."""
