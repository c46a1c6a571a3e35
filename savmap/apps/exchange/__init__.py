"""Exchange with other programs: surveys out of tables, drawings and building models, and maps in their formats."""

from savmap.plugin.apps import App, Command

APP = App(
    commands={
        "import": Command(
            f"{__name__}.command:import_", "Make a survey file out of tables, drawings and building models."
        )
    },
    formats={
        "tum": f"{__name__}.trajectories:write_tum",
        "colmap": f"{__name__}.trajectories:write_colmap",
        "nerfstudio": f"{__name__}.trajectories:write_nerfstudio",
        "mcap": f"{__name__}.recordings:write_mcap",
        "rosbag2": f"{__name__}.recordings:write_rosbag2",
        "rrd": f"{__name__}.recordings:write_rerun",
        "usda": f"{__name__}.usd:write_usda",
        "usdc": f"{__name__}.usd:write_usdc",
        "ifc": f"{__name__}.ifc:write_ifc4",
        "ifc4x3": f"{__name__}.ifc:write_ifc4x3",
        "dxf": f"{__name__}.dxf:write_dxf",
        "nav2": f"{__name__}.nav2:write_nav2",
        "lif": f"{__name__}.fleets:write_lif",
    },
)
