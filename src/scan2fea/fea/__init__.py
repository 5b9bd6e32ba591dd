"""fea (see docs/design.md)."""
