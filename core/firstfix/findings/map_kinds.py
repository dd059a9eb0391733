"""Kinds of findings of maps and of their versions: what each code says, and what helps."""

from __future__ import annotations

from .finding import Severity
from .kind import FindingKind

PAGE = "docs/how-to/my-map.md"


def _kind(
    code: str, severity: Severity, symptom: str, text: str, remedy: str, *, holds_back: bool = False
) -> FindingKind:
    """The kind. An error always holds a version back: of merged sessions, it does not refuse the map."""
    return FindingKind(code, severity, symptom, text, remedy, PAGE, holds_back or severity is Severity.ERROR)


MAP_UNIT = _kind(
    "map_unit",
    Severity.ERROR,
    "The map has another unit than the metre",
    "The map is {extent}{spacing}: is its unit {unit}?",
    "Give --scale {scale:g} (build config: scale: {scale:g}), or export it in metres.",
)
MAP_TOO_COARSE = _kind(
    "map_too_coarse",
    Severity.ERROR,
    "The map's points are metres apart",
    "The map is {extent}{spacing}: so few points show no surface.",
    "Thin the map less: 0.05 to 0.2 m between points is good. If its unit is not the metre, give --scale.",
)
MAP_GARBLED = _kind(
    "map_garbled",
    Severity.ERROR,
    "The map's numbers are no coordinates",
    "The map is {extent}: no place is so large, in any unit. These numbers are no coordinates.",
    "Is the file damaged, as by a transfer in text mode, or are its columns or fields others than x, y, z? "
    "Copy it again, or export it anew.",
)
MAP_FEW_POINTS = _kind(
    "map_few_points",
    Severity.ERROR,
    "The map has too few points",
    "The map has {points:,.0f} points: at least {needed:,.0f} are needed for a surface.",
    "Export the whole map. If it was thinned, thin it less: 0.05 to 0.2 m between points is good.",
)
MAP_FLAT = _kind(
    "map_flat",
    Severity.ERROR,
    "The map is a floor without walls",
    "The map is {extent}: it has a floor alone, and no walls.",
    "Export all points, not the ground alone: robots are localized by what stands on the floor.",
)
MAP_FLOAT32 = _kind(
    "map_float32",
    Severity.ERROR,
    "Large coordinates were stored as float32",
    "Coordinates of {largest_m:,.0f} m in float32 are precise to {step_m:.2g} m: the map has lost its shape.",
    "Export it in float64, or shift it before it is saved as float32: "
    "CloudCompare -O -GLOBAL_SHIFT {shift_x_m:.0f} {shift_y_m:.0f} 0 FILE.",
)
MAP_ROUNDED = _kind(
    "map_rounded",
    Severity.WARNING,
    "Large coordinates were stored as float32, and a little precision is lost",
    "Coordinates of {largest_m:,.0f} m in float32 are precise to {step_m:.2g} m.",
    "Export it in float64, or shift it before it is saved as float32: "
    "CloudCompare -O -GLOBAL_SHIFT {shift_x_m:.0f} {shift_y_m:.0f} 0 FILE.",
)
MAP_DIGITS_LOST = _kind(
    "map_digits_lost",
    Severity.ERROR,
    "The coordinates have too few digits",
    "The coordinates ({axes}) lie on steps of {step_m:.2g} m, with numbers up to {largest_m:,.0f}: {cause}, "
    "and the map has lost its shape.",
    "{export}, or shift the map before: CloudCompare -O -GLOBAL_SHIFT {shift_x_m:.0f} {shift_y_m:.0f} 0 "
    "FILE.",
)
MAP_DIGITS_FEW = _kind(
    "map_digits_few",
    Severity.WARNING,
    "The coordinates have few digits, and precision is lost",
    "The coordinates ({axes}) lie on steps of {step_m:.2g} m, with numbers up to {largest_m:,.0f}: {cause}.",
    "{export}, or shift the map before: CloudCompare -O -GLOBAL_SHIFT {shift_x_m:.0f} {shift_y_m:.0f} 0 "
    "FILE.",
)
MAP_MEMORY = _kind(
    "map_memory",
    Severity.ERROR,
    "The map needs more memory than there is",
    "{points:,.0f} points need about {needed_gb:.1f} GB of memory, and a build may take {there_gb:.1f} GB.",
    "Thin the map to one point in 0.1 m, split it, or give the build more memory "
    "(FIRSTFIX_BUILD_MAX_MEMORY_BYTES, or the container's limit).",
)
TRAJECTORY_IS_CLOUD = _kind(
    "trajectory_is_cloud",
    Severity.ERROR,
    "The trajectory is a point cloud",
    "Of {poses:,.0f} poses, {touching_share:.0%} lie on a surface of the map: this is a point cloud, and no "
    "trajectory.",
    "Give the file of the sensor's poses (TUM, KITTI or CSV), or build without --trajectory.",
)
TRAJECTORY_ELSEWHERE = _kind(
    "trajectory_elsewhere",
    Severity.ERROR,
    "The trajectory lies outside the map",
    "Of {poses:,.0f} poses, {outside_share:.0%} lie over {margin_m:.0f} m outside the map.",
    "Give the poses in the map's own frame and in metres: T_map_sensor of this file, from the same run.",
)
TRAJECTORY_LEFT_OUT = _kind(
    "trajectory_left_out",
    Severity.WARNING,
    "The poses that came with the map are none of its sensor",
    "The {poses:,.0f} poses that came with the map are left out: {why}.",
    "Nothing needs to be done: the map is built without them. If you have the sensor's poses, give them with "
    "--trajectory.",
)
TRAJECTORY_OF_BASE = _kind(
    "trajectory_of_base",
    Severity.WARNING,
    "The poses are those of the robot's base, not of its sensor",
    "The poses lie in the floor: {height_m:.2f} m over it in the middle of {poses:,.0f}, and "
    "{low_share:.0%} of them less than {low_m:.2f} m. No scan can be taken from there: these are poses of "
    "the robot's base, not of the sensor.",
    "Give --mount-height (build config: trajectory_mount_height_m): the metres of the sensor over the base."
    " Or give the sensor's own poses.",
    holds_back=True,
)
TRAJECTORY_AT_FLOOR = _kind(
    "trajectory_at_floor",
    Severity.WARNING,
    "The poses may be those of the robot's base",
    "The poses lie {height_m:.2f} m over the floor, in the middle of {poses:,.0f}: few sensors are so low. "
    "Are these poses of the robot's base?",
    "If they are, give --mount-height (build config: trajectory_mount_height_m): the metres of the sensor "
    "over the base. If the sensor is so low, all is well.",
)
TRAJECTORY_W_FIRST = _kind(
    "trajectory_w_first",
    Severity.WARNING,
    "The poses lie on their side or on their back",
    "Of {poses:,.0f} poses {upright_share:.0%} stand upright as they were read, with the quaternion's w last,"
    " and {w_first_share:.0%} with w first.",
    "Name the columns in a first line of the file: # timestamp x y z qw qx qy qz. If the sensor hangs upside "
    "down, and drove straight on, all is well.",
)
TRAJECTORY_LEANS = _kind(
    "trajectory_leans",
    Severity.WARNING,
    "The trajectory leans against the map",
    "The trajectory of {poses:,.0f} poses leans by {lean_deg:.1f} degrees against the map: its height over "
    "the floor goes from {lowest_m:.1f} m near {near} to {highest_m:.1f} m near {to}, as for "
    "{leaning_share:.0%} of the poses.",
    "One of the two was levelled and the other was not, or they are turned against each other: give both in"
    " one frame, as the SLAM package wrote them. Without --trajectory the map is built, too.",
    holds_back=True,
)
TRAJECTORY_TURNED = _kind(
    "trajectory_turned",
    Severity.WARNING,
    "The trajectory is turned or mirrored against the map",
    "The trajectory of {poses:,.0f} poses fits the map far better {mirrored}turned by {turn_deg:.0f} "
    "degrees: {nearer_share:.0%} nearer to the map's points.",
    "Give the poses in the map's own frame: T_map_sensor of this file, x and y not exchanged, from the same "
    "run. Without --trajectory the map is built, too.",
    holds_back=True,
)
TRAJECTORY_MAYBE_TURNED = _kind(
    "trajectory_maybe_turned",
    Severity.WARNING,
    "The trajectory may be turned or mirrored against the map",
    "The trajectory of {poses:,.0f} poses fits the map better {mirrored}turned by {turn_deg:.0f} degrees: "
    "{nearer_share:.0%} nearer to the map's points, and {copy_touching_share:.0%} of the poses at a surface "
    "in place of {touching_share:.0%}.",
    "Open map and trajectory in one viewer: do the poses lie on the mapping run's way? Then all is well. "
    "Otherwise give them in the map's own frame: T_map_sensor of this file, from the same run.",
)
MAP_NOT_LEVEL = _kind(
    "map_not_level",
    Severity.WARNING,
    "The map's floor is upright",
    "The largest flat surface is not level: across y lie {level_y_share:.0%} of the surface, across z "
    "{level_z_share:.0%}. Does y point up?",
    "Give --axis y-up (build config: axis: y-up) if it does. Otherwise turn the map: z is up.",
    holds_back=True,
)
MAP_DOUBLED_WALLS = _kind(
    "map_doubled_walls",
    Severity.WARNING,
    "Walls are there twice, some decimetres apart",
    "{doubled_share:.0%} of the walls have a parallel twin, {apart_m:.2f} m apart on average, as near "
    "{near}: was a loop of the mapping run not closed?",
    "Close the loop in the SLAM package and export the map again. Poses near there may be off by that.",
)
MAP_DOUBLED_FLOORS = _kind(
    "map_doubled_floors",
    Severity.WARNING,
    "Floors are there twice, one some decimetres above the other",
    "{doubled_share:.0%} of the floor is there twice, {apart_m:.2f} m apart and up to {largest_m:.2f} m, as"
    " near {near}; {by}: was a loop of the mapping run not closed in height?",
    "Close the loop in the SLAM package and export the map again. Heights near there may be off by that.",
)
MAP_NO_GROUND = _kind(
    "map_no_ground",
    Severity.WARNING,
    "The map has no ground",
    "Below {bare_share:.0%} of {count:,.0f} {what} there is no floor, as near {near}: was the ground taken "
    "out?",
    "Export all points, the ground as well: scans see it, and templates stand on it.",
)
MAP_SINGLE_SCAN = _kind(
    "map_single_scan",
    Severity.WARNING,
    "The map is a single scan",
    "All points are seen from one place, {viewpoint}: only in {hidden_share:.0%} of the directions is "
    "something behind something else. This is a single scan, and no map.",
    "Give the map that your SLAM made of all scans. Of a single station of a scanner a map can be built, but "
    "robots are found near its place alone.",
)
MAP_FLOOR_LEFT_OUT = _kind(
    "map_floor_left_out",
    Severity.WARNING,
    "Much of the floor has no template",
    "{left_out_share:.0%} of the floor that the mapping run saw has no template: holes or steps cut it off.",
    "Look at the preview. Close gaps by viewpoints.bridge_gap_m, or map the missing floor.",
)
MAP_IN_PART = _kind(
    "map_in_part",
    Severity.WARNING,
    "Robots are lost in rooms or side streets that the mapping run looked into and did not enter",
    "Of {places:,.0f} places, {in_part:,.0f} were mapped in part, from a door or from afar: over a quarter "
    "of the space around them was never seen.",
    "Drive through them while mapping. The picture of localizability hatches them.",
)
MAP_HELD_BACK = _kind(
    "map_held_back",
    Severity.WARNING,
    "The map has a finding with which no version is activated",
    "The map's check found {codes}: the version is published, and not activated.",
    "Do what that finding says, and build again. To serve it all the same: firstfix maps activate {map_id} "
    "{version}.",
)
SELF_TEST_NONE = _kind(
    "self_test_none",
    Severity.WARNING,
    "The self-test asked nothing",
    "The self-test was to ask {wanted:,.0f} scans in this map, and found no place to take one at: the "
    "version is published, and not activated.",
    "Look at the preview: is the floor there, and the trajectory on it? A version without a self-test is "
    "activated if the build config says so: self_test: {{queries: 0}}. To serve this one all the same: "
    "firstfix maps activate {map_id} {version}.",
)
SELF_TEST_LOW = _kind(
    "self_test_low",
    Severity.WARNING,
    "The self-test does not find its own places",
    "The self-test found the places of {found:.0%} of its scans in this map, and a version is activated from "
    "{least:.0%} on: it is published, and not activated.",
    "Look at the other findings. To serve it all the same: firstfix maps activate {map_id} {version}, or "
    "build with a lower --min-found (build config: activate: min_found).",
)
SELF_TEST_CHANGED_LOW = _kind(
    "self_test_changed_low",
    Severity.WARNING,
    "The self-test does not find the changed part of the map",
    "The self-test found the places of {found:.0%} of its scans in the part that has changed since the "
    "version before, and a version is activated from {least:.0%} on: it is published, and not activated.",
    "Look at the map there. To serve it all the same: firstfix maps activate {map_id} {version}, or build "
    "with a lower --min-found (build config: activate: min_found).",
)
SELF_TEST_REAL_LOW = _kind(
    "self_test_real_low",
    Severity.WARNING,
    "Held-out real scans are not found",
    "Of {asked:,.0f} held-out real scans the places of {found:,.0f} were found. That is less than "
    "{least:.0%} by more than chance: the version is published, and not activated.",
    "Is the sensor the one that mapped, and are the scans of this map? To serve it all the same: firstfix "
    "maps activate {map_id} {version}, or build with a lower activate: min_real_found in the build config.",
)
SELF_TEST_WORSE = _kind(
    "self_test_worse",
    Severity.WARNING,
    "The new version is worse than the active one",
    "The self-test found the places of {found:.0%} of its scans, and of {before:.0%} with the active "
    "version: it is published, and not activated.",
    "Compare the two versions. To serve it all the same: firstfix maps activate {map_id} {version}.",
)
MAP_PATCHED = _kind(
    "map_patched",
    Severity.INFO,
    "The map was patched by what queries saw",
    "By {queries:,.0f} queries of {robots:,.0f} robots, {areas:,.0f} places of the map have changed: "
    "{added:,.0f} points were added and {removed:,.0f} removed.",
    "Compare it with version {base}. To take it back: firstfix maps rollback MAP.",
)
PATCH_PROPOSED = _kind(
    "patch_proposed",
    Severity.INFO,
    "A patched version waits for somebody to activate it",
    "The patched version is published, and not activated. At {places:,.0f} unchanged places {before:,.0f} "
    "scans were localized before, and {after:,.0f} with it.",
    "Look at it, then: firstfix maps activate {map_id} {version}.",
)
PATCH_WORSE = _kind(
    "patch_worse",
    Severity.WARNING,
    "The patched version is worse at places that have not changed",
    "At {places:,.0f} unchanged places {before:,.0f} scans were localized before and {after:,.0f} with the "
    "patch, {wrong_before:,.0f} and {wrong_after:,.0f} wrongly: it is published, and not activated.",
    "Compare the two versions. To serve it all the same: firstfix maps activate {map_id} {version}.",
)
PATCH_OUTDATED = _kind(
    "patch_outdated",
    Severity.WARNING,
    "Another version was activated while a patch was made",
    "The patch was made for version {base}, and another one is active: it is published, and not activated.",
    "Ask for a patch of the active version. To serve this one all the same: firstfix maps activate {map_id} "
    "{version}.",
)
