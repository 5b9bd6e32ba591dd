"""tetmeshing (see docs/design.md)."""
