"""Names of the stages of a build, in order. Importing them imports none of the tools of the stages."""

STAGES = (
    "read_map",
    "reconstruct_mesh",
    "sample_viewpoints",
    "fit_engine",
    "make_templates",
    "cluster",
    "learn_keys",
    "build_index",
    "draw_cloud",
    "self_test",
)
PROVISIONAL = "provisional"  # after read_map, where a provisional version is made: all of its stages together
