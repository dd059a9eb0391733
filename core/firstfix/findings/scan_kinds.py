"""Kinds of findings of scans: what each code says, and what helps."""

from __future__ import annotations

from .finding import Severity
from .kind import FindingKind

PAGE = "docs/how-to/my-scan-is-not-localized.md"


def _kind(
    code: str, symptom: str, text: str, remedy: str, severity: Severity = Severity.ERROR
) -> FindingKind:
    return FindingKind(code, severity, symptom, text, remedy, PAGE)


# By the scan's own points.
SCAN_EMPTY = _kind(
    "scan_empty",
    "The scan has no points",
    "The scan has no points.",
    "Look at the driver: the LiDAR sends nothing, or the file was written before the first scan came.",
)
NOTHING_VALID = _kind(
    "nothing_valid",
    "All points are NaN, infinite or (0, 0, 0)",
    "None of {points:,.0f} points is a return: {not_finite:,.0f} are NaN or infinite, {zero:,.0f} are "
    "(0, 0, 0).",
    "Look at the driver: it writes these for beams without a return. Is the sensor covered or starting?",
)
UNIT_MILLIMETRES = _kind(
    "unit_millimetres",
    "The ranges are a thousand times too long",
    "{points:,.0f} points, {in_range:,.0f} of them in range, median range {median_range_m:,.0f} m: "
    "millimetres?",
    "Send metres: divide the coordinates by 1000.",
)
UNIT_CENTIMETRES = _kind(
    "unit_centimetres",
    "The ranges are a hundred times too long",
    "{points:,.0f} points, {in_range:,.0f} of them in range, median range {median_range_m:,.0f} m: "
    "centimetres?",
    "Send metres: divide the coordinates by 100.",
)
MAP_COORDINATES = _kind(
    "map_coordinates",
    "The coordinates are those of a map projection, as UTM",
    "The points lie {median_range_m:,.0f} m from the sensor, but within {spread_m:,.0f} m of each other: "
    "they have the coordinates of a map, as UTM.",
    "Send the scan in the sensor's frame, where the sensor is at (0, 0, 0).",
)
NO_COORDINATES = _kind(
    "no_coordinates",
    "The numbers are no coordinates: other columns or another byte order than those of the file",
    "{points:,.0f} points, {in_range:,.0f} of them in range, median range {median_range_m:.1e} m: in no unit "
    "is that a LiDAR's.",
    "Look at how the file was written: its columns, their types and their byte order.",
)
ALL_TOO_NEAR = _kind(
    "all_too_near",
    "All points are near the sensor",
    "{points:,.0f} points, {in_range:,.0f} of them in range, the farthest at {largest_range_m:.2f} m: a "
    "wrong unit, or only the robot itself.",
    "Send metres. If the unit is right, the sensor sees only the robot or a cover.",
)
TRANSPOSED = _kind(
    "transposed",
    "The array is (3, n) in place of (n, 3)",
    "The points lie on the line x = y = z: the numbers of one axis stand one after another, as in an array "
    "(3, n).",
    "Transpose the array: scans are (n, 3), one row for each point.",
)
COLUMNS_SHIFTED = _kind(
    "columns_shifted",
    "The intensity is the first column",
    "The columns are intensity, x, y, z: {evidence}.",
    "Send x, y, z first, then the intensity.",
)
ONE_PLANE = _kind(
    "one_plane",
    "The points are those of one ring, or of a 2-D LiDAR",
    "All {in_range:,.0f} points in range lie in one plane or ring: one ring of a LiDAR, or a "
    "2-D LiDAR's scan.",
    "Send all rings of the LiDAR. 2-D LiDARs are not supported.",
)
FEW_POINTS = _kind(
    "few_points",
    "The scan has too few points",
    "{points:,.0f} points, {in_range:,.0f} of them within {min_range_m:g} to {max_range_m:g} m: too few. At "
    "least {needed:,.0f} cells of {voxel_m:g} m must have one.",
    "Send the whole scan, unfiltered: firstfix thins it itself. Is the sensor covered?",
)

# By where the scan was taken from.
OTHER_VIEWPOINT = _kind(
    "other_viewpoint",
    "The scan is in the map's or the odometry's frame, as /cloud_registered of FAST-LIO or LIO-SAM",
    "The points were not taken from (0, 0, 0), but near ({x_m:.1f}, {y_m:.1f}, {z_m:.1f}): seen from there, "
    "they lie in {spread_ratio:.1f} times as many directions.",
    "Send the scan in the sensor's frame: the driver's topic, and not that of the SLAM program.",
)
NO_VIEWPOINT = _kind(
    "no_viewpoint",
    "A map was sent as a scan",
    "The {in_range:,.0f} points were not taken from one place: they are evenly spread, as those of a map.",
    "Send one scan of the LiDAR, in the sensor's frame.",
)

# By trying: the scan would fit if it were another one.
MIRRORED = _kind(
    "mirrored",
    "An axis has the wrong sign, or two axes are swapped (Unity, Gazebo, left-handed drivers)",
    "The scan fits when mirrored in {axis} (inliers {inlier_ratio:.2f} against {inlier_ratio_as_sent:.2f}).",
    "Turn the sign of one axis in the driver: x is forward, y left, z up. Two swapped axes look the same.",
)
POLAR = _kind(
    "polar",
    "Range and angles were sent as x, y, z",
    "The scan fits with its columns taken as range, azimuth and elevation (inliers {inlier_ratio:.2f} "
    "against {inlier_ratio_as_sent:.2f}).",
    "Send x, y, z in metres.",
)
SCALED = _kind(
    "scaled",
    "The scan has another scale than the map: feet, yards, a wrong calibration",
    "The scan fits when scaled by {scale:.4g} (inliers {inlier_ratio:.2f} against "
    "{inlier_ratio_as_sent:.2f}){unit}.",
    "Multiply the coordinates by {scale:.4g}, or build the map in the scan's unit: both are in metres.",
)
GRAVITY_SIGN = _kind(
    "gravity_sign",
    "Gravity has the wrong sign: an IMU at rest reports +9.81 upwards",
    "Gravity contradicts the scan: without it, or turned round, the scan fits (inliers {inlier_ratio:.2f} "
    "against {inlier_ratio_as_sent:.2f}). Sign?",
    "Send the direction that points down: the negated acceleration of an IMU at rest.",
)
GRAVITY_WRONG = _kind(
    "gravity_wrong",
    "Gravity is that of another frame",
    "Gravity contradicts the scan: without it, the scan fits (inliers {inlier_ratio:.2f} against "
    "{inlier_ratio_as_sent:.2f}), with up {off_deg:.0f} deg from it.",
    "Turn the IMU's gravity into the sensor's frame, or leave it out.",
)
PRIOR_WRONG = _kind(
    "prior_wrong",
    "The prior excludes the place",
    "The scan fits outside the prior: {distance_m:.1f} m from its middle (inliers {inlier_ratio:.2f}).",
    "Widen the prior, or leave it out.",
)
MOUNTING = _kind(
    "mounting",
    "The sensor hangs or lies otherwise than the request says",
    "The {body} stands at roll {roll_deg:.0f} deg, pitch {pitch_deg:.0f} deg in the map.",
    "If the robot stands upright, correct T_base_sensor (the URDF).",
    Severity.WARNING,
)

# By the times of its points.
TIME_FIELD_UNKNOWN = _kind(
    "time_field_unknown",
    "A field of the scan looks like the times of its points and was not understood",
    "The field {field} was not understood as times of the points: {why}.",
    "If the robot moved: ask while it stands, or send times in nanoseconds or seconds from the scan's stamp.",
    Severity.WARNING,
)

# By the best place.
NO_PLACE_FITS = _kind(
    "no_place_fits",
    "Little of the scan lies on the map",
    "At the best place, {inlier_ratio:.0%} of the scan lies on the map: too little.",
    "Is it the right map? Was the scan taken outside it, or has the place changed much?",
    Severity.WARNING,
)
UNSURE = _kind(
    "unsure",
    "The best place is not sure enough",
    "The best place explains {inlier_ratio:.0%} of the scan, with probability {probability:.2f}: too unsure.",
    "Try a scan from another spot, with more in view, or send two scans with odometry.",
    Severity.WARNING,
)
SEVERAL_PLACES = _kind(
    "several_places",
    "Several places look alike",
    "{places:.0f} places explain the scan about as well.",
    "Send a prior, or a second scan from where the answer's hint leads; without one, none near would tell.",
    Severity.WARNING,
)
THROUGH_SURFACES = _kind(
    "through_surfaces",
    "The scan looks through walls of the map",
    "At the best place, {free_space_violation:.0%} of the scan's directions pass through surfaces of the "
    "map.",
    "Has a wall or a door gone? Build the map anew; or the scan was taken elsewhere.",
    Severity.WARNING,
)
NOT_CONVERGED = _kind(
    "not_converged",
    "The alignment did not come to rest",
    "The scan could not be aligned to the map at the best place.",
    "Try a scan from another spot.",
    Severity.WARNING,
)
NO_TIMES = _kind(
    "no_times",
    "The scan was taken in motion, and has no times of its points",
    "The scan has no times of its points: it was taken for one of a sensor at rest.",
    "If the robot moved: ask while it stands, or send the times of the points.",
    Severity.INFO,
)
NO_CANDIDATE = _kind(
    "no_candidate",
    "No place of the map may be the answer",
    "No place of the map is within the prior.",
    "Widen the prior, or leave it out.",
)
MAPS_LEFT_OUT = _kind(
    "maps_left_out",
    "No map was named, and not all were searched",
    "No map was named: {searched:.0f} of {maps:.0f} maps were searched, those that resemble the scan most.",
    "Name the map of the robot, or up to 16 that it may be in.",
    Severity.INFO,
)
NOT_REGISTERED = _kind(
    "not_registered",
    "The query had no points",
    "The query had a descriptor and no points: the hypotheses are only candidates.",
    "Send points to get a pose.",
    Severity.INFO,
)
