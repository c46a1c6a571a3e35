"""Where torch computes: on a CUDA device where there is one, else on the processor. `CUDA_VISIBLE_DEVICES=` (empty)
hides the devices."""

import os
from contextlib import AbstractContextManager, nullcontext

import torch

MOST_THREADS = 8


def compute_device() -> torch.device:
    """The first CUDA device that torch can use, else the processor."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def device_of(module: torch.nn.Module) -> torch.device:
    """Where a network's weights are."""
    return next(module.parameters()).device


def threads_beside(device: torch.device) -> int:
    """How many threads prepare pictures while a device computes: one beside a processor, which computes with its cores
    itself."""
    return 1 if device.type == "cpu" else min(os.cpu_count() or 1, MOST_THREADS)


def fast_arithmetic(device: torch.device) -> AbstractContextManager[object]:
    """bfloat16 where a device computes with it, else nothing."""
    if device.type == "cpu":
        capable = torch.cpu.get_capabilities()
        fast = bool(capable.get("avx512_bf16") or capable.get("amx_bf16"))
    else:
        fast = torch.cuda.is_bf16_supported(including_emulation=False)
    if not fast:
        return nullcontext()
    context: AbstractContextManager[object] = torch.autocast(device.type, dtype=torch.bfloat16)
    return context
