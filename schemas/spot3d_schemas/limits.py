"""The limits of the wire contract: nothing larger is sent or decoded, whatever its bytes say."""

MAX_MESSAGE_BYTES = 64 * 2**20
"""Longest message."""

MAX_IMAGE_PIXELS = 2**22
"""Largest image: 4.2 million pixels (2048 x 2048); with float32 depth such a heat message is 34 MB."""

MAX_IMAGE_SIDE = 8192
"""Widest and highest image, pixels."""

MAX_BOXES = 10_000
"""Most proposals of one frame."""

MAX_SEGMENTS = 255
"""Most segments of one frame: what a byte can tell apart from background."""

MAX_PLANES = 32
"""Most supporting planes of one frame."""

MAX_OBJECTS = 10_000
"""Most objects of one update."""

MAX_MAP_POINTS = 2_000_000
"""Most points of one snapshot of the 3D heatmap; 23 bytes each, 46 MB."""

MAX_MAP_CHANGES = 40_000
"""Most points of one answer with changes of the map; 24 bytes each, just below 1 MB."""

MAX_CORRECTIONS = 1024
"""Most earlier poses that one pose corrects."""

BEND_SHAPE = 4, 6
"""Rows and columns of the image's lattice on which a pose states the bend of depth."""

MAX_BEND = 0.1
"""Maximum bend of depth, logarithm: a camera that is off by a tenth shows nothing."""

MIN_DEPTH_NOISE, MAX_DEPTH_NOISE = 1e-6, 0.1
"""Least and largest standard deviation of a camera's depth, metres; the largest at 1 m."""

MAX_LEAST_NOISY_RANGE = 10.0
"""Maximum of the range with the least noise, metres."""

MAX_PREVIEW_PIXELS = 320 * 320
"""Largest preview: dashboards over thin links get no more of a frame than this."""
MAX_COUNT = 2**63 - 1
"""Largest count; also the latest stamp."""

MAX_HOPS = 16
"""Most entries of a header's trace."""

MAX_REASONS = 64
"""Most entries of a map reason -> count."""

MAX_NAME = 64
"""Longest robot, stage, frame and reason name, characters."""

MAX_TEXT = 1000
"""Longest free text (an error, the reason of a lost pose), characters; longer texts are cut, not refused."""

MAX_FIELDS = 64
"""Most fields of one message, those of newer minor versions included."""

MAX_FIELD_BYTES = 2**16
"""Longest field that is not an array."""

MAX_VALUES = 4096
"""Most msgpack values of one message, so that many tiny values cannot be blown up into much memory."""

MAX_OBJECTS_BYTES = 8 * 2**20
"""Longest list of objects; takes the place of MAX_FIELD_BYTES in Objects."""

MAX_OBJECTS_VALUES = 64 * MAX_OBJECTS
"""Most msgpack values of Objects (today's object has 35); takes the place of MAX_VALUES."""

MAX_DECODE_BYTES = 2 * MAX_MESSAGE_BYTES
"""Maximum memory that decoding one message allocates at any time, the message itself not counted. It follows from the
limits above, and tests measure it; the decoder itself does not count it."""
