"""The segmentation network: an EfficientNet-Lite0 encoder cut at stride 32 and a light decoder with sharp edges.

The decoder's last step, at stride 2, also reads the picture's own pixels, and its result is unfolded to full size, so
that each of the four pixels it stands for has weights of its own: edges are placed precisely without a full-size
convolution.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

INPUT_MEAN, INPUT_SCALE = 127.0, 128.0
"""Input normalisation with which the ImageNet weights of EfficientNet-Lite were trained."""

BLOCKS = (
    # input, output, kernel, stride, expansion
    (32, 16, 3, 1, 1),
    (16, 24, 3, 2, 6),
    (24, 24, 3, 1, 6),
    (24, 40, 5, 2, 6),
    (40, 40, 5, 1, 6),
    (40, 80, 3, 2, 6),
    (80, 80, 3, 1, 6),
    (80, 80, 3, 1, 6),
    (80, 112, 5, 1, 6),
    (112, 112, 5, 1, 6),
    (112, 112, 5, 1, 6),
    (112, 192, 5, 2, 6),
    (192, 192, 5, 1, 6),
)
STAGE_ENDS = (0, 2, 4, 10, 12)
"""Blocks whose outputs the decoder reads: strides 2, 4, 8, 16 and 32 with 16, 24, 40, 112 and 192 channels."""
FIXED_BLOCKS = 3
"""How many blocks, beside the stem, keep their ImageNet weights."""
FOLD_EPSILON = 1e-3
"""The epsilon of the published weights' batch normalisation."""


class SameConv(nn.Conv2d):
    """Convolution with bias that pads as TensorFlow does ("SAME"): at stride 2, more to the right and below."""

    def forward(self, input: Tensor) -> Tensor:
        total = self.kernel_size[0] - self.stride[0]
        before, after = total // 2, total - total // 2
        if before == after:
            return functional.conv2d(input, self.weight, self.bias, self.stride, before, 1, self.groups)
        padded = functional.pad(input, (before, after, before, after))
        return functional.conv2d(padded, self.weight, self.bias, self.stride, 0, 1, self.groups)


def relu6(features: Tensor) -> Tensor:
    """Clip to 0..6, in place."""
    return functional.relu6(features, inplace=True)


def in_float32(convolve: SameConv, features: Tensor) -> Tensor:
    """The convolution in float32 even where autocast is on: gradients of bfloat16 depthwise ones are slow on
    processors."""
    if not (torch.is_autocast_enabled("cpu") and convolve.weight.requires_grad):
        result: Tensor = convolve(features)
        return result
    with torch.autocast("cpu", enabled=False):
        result = convolve(features.float())
        return result


class Block(nn.Module):
    """Inverted bottleneck (MobileNetV2), the normalisation folded into its convolutions."""

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int, expansion: int) -> None:
        super().__init__()
        inner = inputs * expansion
        self.skips = stride == 1 and inputs == outputs
        self.expand = SameConv(inputs, inner, 1) if expansion != 1 else None
        self.depthwise = SameConv(inner, inner, kernel, stride, groups=inner)
        self.project = SameConv(inner, outputs, 1)

    def forward(self, features: Tensor) -> Tensor:
        x = features if self.expand is None else relu6(self.expand(features))
        x = self.project(relu6(in_float32(self.depthwise, x)))
        return x + features if self.skips else x


class Encoder(nn.Module):
    """EfficientNet-Lite0, the first two blocks of stride 32 included; (N, 3, H, W) -> one map for each of five strides.

    The blocks at strides 2 and 4 are not trained: they cost the most and know textures of the real world already.
    """

    def __init__(self) -> None:
        super().__init__()
        self.stem = SameConv(3, 32, 3, 2)
        self.blocks = nn.ModuleList(Block(*shape) for shape in BLOCKS)
        for fixed in (self.stem, *self.blocks[:FIXED_BLOCKS]):
            fixed.requires_grad_(False)

    def forward(self, image: Tensor) -> list[Tensor]:
        x = relu6(self.stem(image))
        stages = []
        for index, block in enumerate(self.blocks):
            x = block(x)
            if index in STAGE_ENDS:
                stages.append(x)
        return stages


def projection(inputs: int, outputs: int, kernel: int = 1, stride: int = 1, groups: int = 1) -> nn.Sequential:
    """Convolution and normalisation."""
    padding = (kernel - 1) // 2
    conv = nn.Conv2d(inputs, outputs, kernel, stride, padding, groups=groups, bias=False)
    return nn.Sequential(conv, nn.BatchNorm2d(outputs, momentum=0.03))


def convolution(inputs: int, outputs: int, kernel: int = 1, groups: int = 1) -> nn.Sequential:
    """Convolution, normalisation, ReLU."""
    return nn.Sequential(*projection(inputs, outputs, kernel, groups=groups), nn.ReLU())


def doubled(features: Tensor) -> Tensor:
    """The feature map at twice the size."""
    return functional.interpolate(features, scale_factor=2.0, mode="bilinear", align_corners=False)


class Context(nn.Module):
    """Looks far around at stride 32 (which row a beam belongs to cannot be told from near by); result at stride 16."""

    def __init__(self, at_16: int, at_32: int, channels: int) -> None:
        super().__init__()
        self.near = projection(at_16, channels)
        self.far = nn.Sequential(
            convolution(at_32, channels),
            convolution(channels, channels, 7, groups=channels),
            convolution(channels, channels),
            convolution(channels, channels, 7, groups=channels),
            projection(channels, channels),
        )

    def forward(self, at_16: Tensor, at_32: Tensor) -> Tensor:
        return functional.relu(self.near(at_16) + doubled(self.far(at_32)))


class Merge(nn.Module):
    """One step of the decoder: the coarser map doubled plus the encoder's map of this stride, then a convolution."""

    def __init__(self, coarse: int, lateral: int, outputs: int) -> None:
        super().__init__()
        self.from_coarse = projection(coarse, outputs)
        self.from_lateral = projection(lateral, outputs)
        self.mix = convolution(outputs, outputs, 3)

    def forward(self, coarse: Tensor, lateral: Tensor) -> Tensor:
        joined = self.from_lateral(lateral) + doubled(self.from_coarse(coarse))
        mixed: Tensor = self.mix(functional.relu(joined))
        return mixed


class Finish(nn.Module):
    """Last step of the decoder, at stride 2: the coarser map, the encoder's map and the picture's own pixels."""

    def __init__(self, coarse: int, lateral: int, channels: int, outputs: int) -> None:
        super().__init__()
        self.from_coarse = projection(coarse, channels)
        self.from_lateral = projection(lateral, channels)
        self.from_pixels = projection(3, channels, kernel=4, stride=2)
        self.mix = convolution(channels, channels, 3)
        self.logits = nn.Conv2d(channels, 4 * outputs, 3, padding=1)

    def forward(self, coarse: Tensor, lateral: Tensor, image: Tensor) -> Tensor:
        joined = self.from_pixels(image) + (self.from_lateral(lateral) + doubled(self.from_coarse(coarse)))
        return functional.pixel_shuffle(self.logits(self.mix(functional.relu(joined))), 2)


class SegmentationNetwork(nn.Module):
    """Picture (N, 3, H, W) float, RGB 0..255, H and W multiples of 32 -> logits (N, C, H, W), background first."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.encoder = Encoder()
        self.context = Context(112, 192, 96)
        self.to_8 = Merge(96, 40, 48)
        self.to_4 = Merge(48, 24, 32)
        self.finish = Finish(32, 16, 16, classes + 1)

    def forward(self, image: Tensor) -> Tensor:
        centred = (image - INPUT_MEAN) / INPUT_SCALE
        at_2, at_4, at_8, at_16, at_32 = self.encoder(centred)
        x = self.to_8(self.context(at_16, at_32), at_8)
        x = self.to_4(x, at_4)
        logits: Tensor = self.finish(x, at_2, centred)
        return logits


def folded(published: Mapping[str, Tensor], convolution_name: str, normalisation_name: str) -> tuple[Tensor, Tensor]:
    """Weight and bias of a convolution with the batch normalisation that follows it folded in (contiguous)."""
    normalisation = {
        part: published[f"{normalisation_name}.{part}"] for part in ("weight", "bias", "running_mean", "running_var")
    }
    scale = normalisation["weight"] / torch.sqrt(normalisation["running_var"] + FOLD_EPSILON)
    weight = published[f"{convolution_name}.weight"] * scale[:, None, None, None]
    bias = normalisation["bias"] - normalisation["running_mean"] * scale
    return weight.contiguous(), bias.contiguous()


def published_names() -> dict[str, tuple[str, str]]:
    """Our convolution -> names of the convolution and of its normalisation in the published weights."""
    names = {"stem": ("_conv_stem", "_bn0")}
    for index in range(len(BLOCKS)):
        theirs = f"_blocks.{index}"
        if index > 0:
            names[f"blocks.{index}.expand"] = (f"{theirs}._expand_conv", f"{theirs}._bn0")
        names[f"blocks.{index}.depthwise"] = (f"{theirs}._depthwise_conv", f"{theirs}._bn1")
        names[f"blocks.{index}.project"] = (f"{theirs}._project_conv", f"{theirs}._bn2")
    return names


def encoder_weights(published: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """State of `Encoder` from the published EfficientNet-Lite0 weights."""
    state = {}
    for ours, (convolution_name, normalisation_name) in published_names().items():
        state[f"{ours}.weight"], state[f"{ours}.bias"] = folded(published, convolution_name, normalisation_name)
    return state


def build(class_count: int, imagenet: Path | None) -> SegmentationNetwork:
    """A new network for `class_count` classes beside the background; the encoder starts from the file `imagenet`."""
    network = SegmentationNetwork(class_count)
    if imagenet is not None:
        published = torch.load(imagenet, map_location="cpu", weights_only=True)
        network.encoder.load_state_dict(encoder_weights(published))
    return network
