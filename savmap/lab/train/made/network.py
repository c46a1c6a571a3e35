"""The segmentation network: what is where, seen at half size, and edges, seen at full size by a few dense convolutions.

One branch is EfficientNet-Lite0 on the picture at half size, down to stride 32 of the picture: what a thing is, and
which row it belongs to. The other keeps strides 4 and 8 of the full picture, in dense convolutions, which 8-bit
arithmetic likes (two branches: Yu et al., BiSeNet V2, 2021). The result has half the picture's size, four pixels from
each cell at stride 4. The halving is part of the stems: a 3x3 convolution of the mean of 2x2 pixels is a 6x6 one."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.nn import functional

from savmap.lab.train.network import (
    BLOCKS,
    INPUT_MEAN,
    INPUT_SCALE,
    Block,
    convolution,
    doubled,
    encoder_weights,
    projection,
    relu6,
)

STAGE_ENDS = (0, 2, 4, 10, 12)
"""Blocks whose outputs the decoder reads: strides 4, 8, 16, 32 and 32 of the picture."""
UNSTRIDED = 11
"""The block that would reach stride 64."""
AT_4, AT_8, AT_16, AT_32 = 32, 64, 64, 96
UNFOLDED = 2
STEM_CHANNELS = 32


def stem(outputs: int) -> nn.Conv2d:
    """Reads the picture's pixels, 0..255, at stride 4."""
    return nn.Conv2d(3, outputs, 6, 4, 1)


class TwoScaleNetwork(nn.Module):
    """Picture (N, 3, H, W) float, RGB 0..255, H and W multiples of 32 -> logits (N, C, H/2, W/2) of the classes; the
    background's is 0."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.stem = stem(STEM_CHANNELS)
        shapes = [(*shape[:3], 1 if index == UNSTRIDED else shape[3], shape[4]) for index, shape in enumerate(BLOCKS)]
        self.blocks = nn.ModuleList(Block(*shape) for shape in shapes)
        self.fine_4 = nn.Sequential(stem(AT_4), nn.BatchNorm2d(AT_4, momentum=0.03), nn.ReLU())
        self.fine_8 = nn.Sequential(
            nn.Conv2d(AT_4, AT_8, 3, 2, 1, bias=False),
            nn.BatchNorm2d(AT_8, momentum=0.03),
            nn.ReLU(),
            *projection(AT_8, AT_8, 3),
        )
        at_4, at_8, at_16, at_32, last = (BLOCKS[index][1] for index in STAGE_ENDS)
        self.far = nn.Sequential(
            convolution(last, AT_32),
            convolution(AT_32, AT_32, 7, groups=AT_32),
            convolution(AT_32, AT_32),
            convolution(AT_32, AT_32, 7, groups=AT_32),
            projection(AT_32, AT_32),
        )
        self.near = projection(at_32, AT_32)
        self.to_16, self.from_16, self.mix_16 = (
            projection(AT_32, AT_16),
            projection(at_16, AT_16),
            convolution(AT_16, AT_16, 3),
        )
        self.to_8, self.from_8 = projection(AT_16, AT_8), projection(at_8, AT_8)
        self.mix_8 = nn.Sequential(convolution(AT_8, AT_8, 3), convolution(AT_8, AT_8, 3))
        self.to_4, self.from_4, self.mix_4 = projection(AT_8, AT_4), projection(at_4, AT_4), convolution(AT_4, AT_4, 3)
        self.logits = nn.Conv2d(AT_4, UNFOLDED**2 * classes, 3, padding=1)

    def forward(self, image: Tensor) -> Tensor:
        stages, x = [], relu6(self.stem(image))
        for index, block in enumerate(self.blocks):
            x = block(x)
            if index in STAGE_ENDS:
                stages.append(x)
        at_4, at_8, at_16, at_32, last = stages
        x = functional.relu(self.near(at_32) + self.far(last))
        x = self.mix_16(functional.relu(self.from_16(at_16) + doubled(self.to_16(x))))
        fine_4 = self.fine_4(image)
        x = self.mix_8(functional.relu(self.from_8(at_8) + self.fine_8(fine_4) + doubled(self.to_8(x))))
        x = self.mix_4(functional.relu(self.from_4(at_4) + fine_4 + doubled(self.to_4(x))))
        return functional.pixel_shuffle(self.logits(x), UNFOLDED)


def probabilities(logits: Tensor) -> Tensor:
    """(N, 1 + C, h, w), background first: softmax with a background's logit of 0, written out because onnxruntime's
    Softmax over channels is slow, and without a sum that 8-bit arithmetic would take over."""
    weights = torch.exp(torch.cat([torch.zeros_like(logits[:, :1]), torch.clamp(logits, -30.0, 30.0)], dim=1))
    return weights / weights.sum(dim=1, keepdim=True)


def start(classes: int, published: Mapping[str, Tensor] | None) -> TwoScaleNetwork:
    """A new network; its encoder begins with the `published` ImageNet weights of EfficientNet-Lite0."""
    network = TwoScaleNetwork(classes)
    with torch.no_grad():
        network.fine_4[0].weight /= INPUT_SCALE
        if published is not None:
            weights = encoder_weights(published)
            kernel = weights.pop("stem.weight")
            wide = kernel.repeat_interleave(2, dim=2).repeat_interleave(2, dim=3) / (4 * INPUT_SCALE)
            bias = weights.pop("stem.bias") - INPUT_MEAN * wide.sum(dim=(1, 2, 3))
            network.load_state_dict({**weights, "stem.weight": wide, "stem.bias": bias}, strict=False)
    return network


class WithProbabilities(nn.Module):
    """The network as mapping runs it."""

    def __init__(self, network: TwoScaleNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> Tensor:
        return probabilities(self.network(image))


def exported(network: TwoScaleNetwork) -> nn.Module:
    """What the ONNX file holds."""
    return WithProbabilities(network).eval()
