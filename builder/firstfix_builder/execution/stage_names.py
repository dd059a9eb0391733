"""The stages of a build in order: told without importing the tools that do their work."""

STAGES = (
    "read_map",
    "reconstruct_mesh",
    "sample_viewpoints",
    "fit_engine",
    "make_templates",
    "cluster",
    "learn_keys",
    "build_index",
    "self_test",
)
