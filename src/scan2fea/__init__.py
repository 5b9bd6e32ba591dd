"""scan2fea: from raw 3D scans to finite element models that check themselves."""

__version__ = "0.1.0"
