"""From meshes and a style to pictures: the one place that drives Blender.

Blender's world is used with y up, as the scenes have it. Its cameras look along -z with y up; ours along z with y down.
"""

import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from savmap.geometry.pinhole import focal_px
from savmap.lab.sim.blender.materials import material
from savmap.lab.sim.blender.mesh import ATTRIBUTES, Floats, Mesh, Shader
from savmap.lab.sim.blender.nodes import Graph
from savmap.lab.sim.blender.style import Fill, Lens, Light, RenderStyle
from savmap.lab.sim.drive.views import CameraSample

Image = NDArray[np.uint8]
_SENSOR_MM = 36.0


@dataclass(frozen=True)
class Effort:
    """How much work goes into a picture."""

    width: int = 640
    height: int = 480
    samples: int = 2
    bounces: int = 2
    threads: int = 2


@contextmanager
def _quiet() -> Iterator[None]:
    """Blender prints progress on the process's own standard output."""
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def _add_mesh(name: Shader, mesh: Mesh, style: RenderStyle) -> None:
    made = bpy.data.meshes.new(name)
    corners = mesh.triangles.ravel().astype(np.int32)
    made.vertices.add(len(mesh.vertices))
    made.vertices.foreach_set("co", mesh.vertices.astype(np.float32).ravel())
    made.loops.add(len(corners))
    made.loops.foreach_set("vertex_index", corners)
    made.polygons.add(len(mesh.triangles))
    made.polygons.foreach_set("loop_start", np.arange(0, len(corners), 3, dtype=np.int32))
    made.polygons.foreach_set("use_smooth", mesh.smooth)
    for attribute in ATTRIBUTES:
        layer = made.attributes.new(attribute, "FLOAT_VECTOR", "POINT")
        layer.data.foreach_set("vector", getattr(mesh, attribute).astype(np.float32).ravel())
    made.update(calc_edges=True)
    made.materials.append(material(name, style))
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, made))


def _pose(origin: Floats, rotation: Floats) -> Any:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, origin
    return mathutils.Matrix(matrix.tolist())


def _towards(direction: Floats) -> Floats:
    """A rotation whose -z points along `direction`."""
    back = -direction / np.linalg.norm(direction)
    side = np.cross([0.0, 0.0, 1.0] if abs(back[2]) < 0.9 else [1.0, 0.0, 0.0], back)
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(back, side), back], axis=1)


def _add_lamp(kind: str, origin: Floats, direction: Floats, color: Any, strength: float, **more: Any) -> None:
    lamp = bpy.data.lights.new(kind, kind)
    lamp.color, lamp.energy = color, strength
    for name, value in more.items():
        setattr(lamp, name, value)
    made = bpy.data.objects.new(kind, lamp)
    made.matrix_world = _pose(origin, _towards(direction))
    made.visible_camera = False
    bpy.context.scene.collection.objects.link(made)


def _add_fill(fill: Fill) -> None:
    """An area lamp of Blender's is as wide as its own x axis, which `_towards` lays along the world's."""
    sides = {"shape": "RECTANGLE", "size": fill.sides_m[0], "size_y": fill.sides_m[1]}
    _add_lamp("AREA", np.array(fill.place), np.array([0.0, -1.0, 0.0]), fill.color, fill.watts, **sides)


def _add_light(light: Light, fills: Sequence[Fill]) -> None:
    world = bpy.data.worlds.new("world")
    bpy.context.scene.world = world
    g = Graph(world.node_tree)
    background = g.made("ShaderNodeBackground", {"Color": (*light.ambient_color, 1.0), "Strength": light.ambient})
    g.made("ShaderNodeOutputWorld", {"Surface": background.outputs[0]})
    for fill in (*light.fills, *fills):
        _add_fill(fill)
    if light.sun:
        _add_lamp("SUN", np.zeros(3), np.array(light.sun_towards), (1.0, 0.93, 0.8), light.sun, angle=0.01)


def _set_cycles(effort: Effort) -> None:
    scene = bpy.context.scene
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = effort.width, effort.height, 100
    render.threads_mode, render.threads = "FIXED", effort.threads
    render.use_persistent_data = True
    cycles.device = "CPU"
    cycles.samples, cycles.use_adaptive_sampling = effort.samples, effort.samples > 16
    cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
    cycles.denoising_quality = "FAST"
    cycles.use_light_tree = False
    cycles.max_bounces = effort.bounces
    cycles.diffuse_bounces = cycles.glossy_bounces = effort.bounces
    cycles.transparent_max_bounces = 12
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.sample_clamp_indirect = 8.0
    cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", 1.5


def set_up(meshes: Mapping[Shader, Mesh], style: RenderStyle, fills: Sequence[Fill], effort: Effort) -> None:
    """Replaces Blender's scene. `fills` light it beside the style's own."""
    with _quiet():
        bpy.ops.wm.read_factory_settings(use_empty=True)
        _set_cycles(effort)
    for name, mesh in meshes.items():
        _add_mesh(name, mesh, style)
    _add_light(style.light, fills)
    blurred = style.lens.f_stop > 0 or style.lens.travel_m > 0 or "wire" in meshes
    bpy.context.scene.cycles.denoising_prefilter = "FAST" if blurred else "NONE"


def _place_camera(eye: CameraSample, lens: Lens, width: int, focus_m: float) -> None:
    scene = bpy.context.scene
    data = bpy.data.cameras.new("camera")
    data.sensor_fit, data.sensor_width, data.clip_end = "HORIZONTAL", _SENSOR_MM, 500.0
    data.lens = focal_px(eye.hfov_deg, width) / width * _SENSOR_MM
    data.dof.use_dof = lens.f_stop > 0
    data.dof.focus_distance, data.dof.aperture_fstop = focus_m, lens.f_stop or 1.0
    camera = bpy.data.objects.new("camera", data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.matrix_world = _pose(eye.origin, eye.world_from_view @ np.diag([1.0, -1.0, -1.0]))
    scene.render.use_motion_blur = lens.travel_m > 0
    scene.render.motion_blur_shutter = 1.0
    for frame, way in ((0, -1), (2, 1)) if lens.travel_m else ():
        camera.location = mathutils.Vector((eye.origin + np.array([way * lens.travel_m, 0.0, 0.0])).tolist())
        camera.keyframe_insert("location", frame=frame)
    scene.frame_set(1)


def _save_as(path: Path, kind: str, depth: str) -> None:
    settings = bpy.context.scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = kind, "RGB", depth
    bpy.data.images["Render Result"].save_render(str(path), scene=bpy.context.scene)


def _load(path: Path, colorspace: str) -> Floats:
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = colorspace
    width, height = image.size
    flat = np.empty(width * height * 4, dtype=np.float32)
    image.pixels.foreach_get(flat)
    bpy.data.images.remove(image)
    picture: Floats = flat.reshape(height, width, 4)[::-1, :, :3].astype(np.float64)
    return picture


def _set_contrast(settings: Any, lens: Lens) -> None:
    """The contrast's name depends on the view transform, and not every transform has it."""
    for name in (f"{lens.view_transform} - {lens.contrast}", lens.contrast, "None"):
        try:
            settings.look = name
        except TypeError:
            continue
        return


def _expose(radiance: Floats, lens: Lens) -> None:
    """Sets Blender's view so that the median of the picture's lit part lands `lens.brightness` stops above middle
    grey."""
    luminance = radiance @ np.array([0.2126, 0.7152, 0.0722])
    middle = float(np.exp(np.median(np.log(luminance + 1e-5))))
    settings = bpy.context.scene.view_settings
    settings.view_transform = lens.view_transform
    _set_contrast(settings, lens)
    settings.exposure = float(np.clip(np.log2(0.18 / middle) + lens.brightness, -10, 10))


def render(eye: CameraSample, lens: Lens, width: int, focus_m: float, seed: int = 0) -> Image:
    """Renders the scene that was set up: RGB, `width` pixels wide. A cart in motion moves along x."""
    scene = bpy.context.scene
    if scene.camera:
        bpy.data.objects.remove(scene.camera)
    _place_camera(eye, lens, width, focus_m)
    scene.cycles.seed = seed
    with tempfile.TemporaryDirectory() as folder, _quiet():
        bpy.ops.render.render()
        raw, shown = Path(folder) / "raw.exr", Path(folder) / "shown.png"
        _save_as(raw, "OPEN_EXR", "32")
        _expose(_load(raw, "Linear Rec.709"), lens)
        _save_as(shown, "PNG", "8")
        return np.round(_load(shown, "Non-Color") * 255).astype(np.uint8)
