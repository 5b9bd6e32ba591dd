"""viewer: shows what a run left in OUT."""

from scan2fea.viewer.browser import open_report as open_report

__all__ = ["open_report"]
