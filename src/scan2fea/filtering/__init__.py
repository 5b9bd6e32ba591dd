"""filtering (see docs/design.md)."""
