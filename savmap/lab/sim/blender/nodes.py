"""A short way to write Blender's shader node trees. Sockets and numbers may stand for one another everywhere."""

from typing import Any

import bpy

Socket = Any


class Graph:
    """Builds nodes in one material's (or world's) tree; every method returns the output socket that it made."""

    def __init__(self, tree: Any) -> None:
        self.tree = tree
        tree.nodes.clear()

    def node(self, kind: str, **properties: Any) -> Any:
        made = self.tree.nodes.new(kind)
        for name, value in properties.items():
            setattr(made, name, value)
        return made

    def feed(self, socket: Any, value: Any) -> None:
        """Connects or sets an input; None leaves it alone."""
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        elif value is not None:
            socket.default_value = value

    def made(self, kind: str, inputs: dict[str, Any], **properties: Any) -> Any:
        node = self.node(kind, **properties)
        for name, value in inputs.items():
            self.feed(node.inputs[name], value)
        return node

    def attribute(self, name: str) -> Socket:
        return self.node("ShaderNodeAttribute", attribute_name=name).outputs["Vector"]

    def parts(self, vector: Socket) -> tuple[Socket, Socket, Socket]:
        out = self.made("ShaderNodeSeparateXYZ", {"Vector": vector}).outputs
        return out[0], out[1], out[2]

    def vector(self, x: Any, y: Any, z: Any) -> Socket:
        return self.made("ShaderNodeCombineXYZ", {"X": x, "Y": y, "Z": z}).outputs[0]

    def math(self, operation: str, first: Any, second: Any = None, third: Any = None) -> Socket:
        node = self.node("ShaderNodeMath", operation=operation)
        for socket, value in zip(node.inputs, (first, second, third), strict=True):
            self.feed(socket, value)
        return node.outputs[0]

    def scaled(self, vector: Socket, factor: Any) -> Socket:
        node = self.node("ShaderNodeVectorMath", operation="SCALE")
        self.feed(node.inputs[0], vector)
        self.feed(node.inputs["Scale"], factor)
        return node.outputs[0]

    def mix(self, share: Any, first: Any, second: Any) -> Socket:
        """Colour `first` where `share` is 0, `second` where it is 1."""
        node = self.node("ShaderNodeMix", data_type="RGBA")
        for index, value in ((0, share), (6, first), (7, second)):
            self.feed(node.inputs[index], rgba(value))
        return node.outputs[2]

    def blend(self, share: Any, first: Any, second: Any) -> Socket:
        """The same for numbers."""
        return self.math("MULTIPLY_ADD", share, self.math("SUBTRACT", second, first), first)

    def tinted(self, color: Any, gain: Any) -> Socket:
        """A colour times a number."""
        return self.mix(1.0, color, self.scaled(color, gain))

    def noise(self, vector: Socket, scale: Any, detail: float = 2.0) -> Socket:
        """Smooth noise around 0.5, of spatial frequency `scale`."""
        inputs = {"Vector": vector, "Scale": scale, "Detail": detail}
        return self.made("ShaderNodeTexNoise", inputs).outputs[0]

    def dice(self, vector: Socket) -> Socket:
        """Uniform random numbers in 0..1, constant where `vector` is."""
        return self.made("ShaderNodeTexWhiteNoise", {"Vector": vector}, noise_dimensions="3D").outputs["Value"]

    def ramp(self, value: Socket, low: Any, high: Any) -> Socket:
        """0 below `low`, 1 above `high`, linear between."""
        inputs = {"Value": value, "From Min": low, "From Max": high}
        return self.made("ShaderNodeMapRange", inputs, clamp=True).outputs[0]

    def inside(self, value: Socket, half: Any) -> Socket:
        """1 where abs(value) < half."""
        return self.math("LESS_THAN", self.math("ABSOLUTE", value), half)

    def saw(self, value: Socket, period: Any) -> Socket:
        """Distance from the middle of the period that `value` is in, -period/2 .. period/2."""
        turns = self.math("DIVIDE", value, period)
        return self.math("MULTIPLY", self.math("SUBTRACT", self.math("FRACT", turns), 0.5), period)


def rgba(value: Any) -> Any:
    """RGB triples as Blender's RGBA; sockets and numbers unchanged."""
    return (*value, 1.0) if isinstance(value, (tuple, list)) and len(value) == 3 else value
