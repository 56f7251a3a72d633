"""Our marker, in metres: a dark plate with a yellow patch in front and a red one behind. Print it as it stands here.

Yellow and red both have red and no blue: water, which is blue and green, comes into neither.
"""

PLATE_LENGTH_M = 0.46
PLATE_WIDTH_M = 0.32
PATCH_LENGTH_M = 0.14
"""Along the vessel's x axis."""
PATCH_WIDTH_M = 0.22
SPACING_M = 0.24
"""Between the centres of the patches, which lie on the x axis as far before the vessel's origin as behind it."""
PLATE_BGR = (38, 36, 36)
FRONT_BGR = (40, 205, 225)
REAR_BGR = (45, 40, 210)
