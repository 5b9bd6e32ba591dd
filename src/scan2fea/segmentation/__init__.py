"""One label per point, and which of them to model (see docs/design.md). A method is one file and one line in `scene.METHODS`."""

from scan2fea.segmentation.around import bodies_around
from scan2fea.segmentation.contact import contact_points, footings
from scan2fea.segmentation.joints import joined_members
from scan2fea.segmentation.options import SegmentationOptions, SelectOptions
from scan2fea.segmentation.scene import METHODS, Method, segment_scene
from scan2fea.segmentation.select import Selection, select
from scan2fea.segmentation.strips import strips_beside

__all__ = [
    "METHODS",
    "Method",
    "SegmentationOptions",
    "SelectOptions",
    "Selection",
    "bodies_around",
    "contact_points",
    "footings",
    "joined_members",
    "segment_scene",
    "select",
    "strips_beside",
]
