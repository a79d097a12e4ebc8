# SPDX-License-Identifier: Apache-2.0
"""Gaussians on a CUDA device, as tensors of PyTorch."""

import importlib
from typing import Any, Dict, Tuple

from .core import Error, Status, check, ffi, lib, struct

# The numbers of a Gaussian in each array of l4d_cuda_gaussian_buffers, and the attribute that it belongs to.
_ARRAYS: Dict[str, Tuple[Tuple[int, ...], str]] = {
    "position": ((3,), "POSITION"), "mean_t": ((), "MEAN_T"), "mean_t_local": ((), "MEAN_T"),
    "log_scale": ((4,), "LOG_SCALE"), "rotor": ((8,), "ROTOR"), "opacity": ((), "OPACITY"), "sh": ((), "SH")}


def _torch() -> Any:
    try:
        return importlib.import_module("torch")
    except ImportError as error:
        raise Error(Status.FEATURE_UNSUPPORTED, "decode_cuda() makes tensors of PyTorch, which is not here") from error


def decode_cuda(decoder: Any, query: Any, sh_degree: int, windows: bool, device: int) -> Dict[str, Any]:
    """What `query` selects, decoded on the device into tensors. decoder: an l4d_decoder, which nothing else uses."""
    torch = _torch()
    out = ffi.new("l4d_cuda_decoder**")
    check(lib.l4d_cuda_decoder_create(decoder, device, out))
    cuda = ffi.gc(out[0], lib.l4d_cuda_decoder_destroy)
    try:
        request = struct("cuda_request", attributes=sum({getattr(lib, f"L4D_CUDA_{a}") for _, a in _ARRAYS.values()}))
        check(lib.l4d_cuda_decoder_prepare(cuda, query, request))
        n, where = request.num_gaussians, torch.device("cuda", device)
        shapes = {name: (n, *shape) for name, (shape, _) in _ARRAYS.items()}
        shapes["sh"] = (n, (sh_degree + 1) ** 2, 3)
        tensors = {name: torch.empty(shape, dtype=torch.float32, device=where) for name, shape in shapes.items()}
        buffers = struct("cuda_gaussian_buffers", capacity=n)
        for name, tensor in tensors.items():
            setattr(buffers, name, ffi.cast("float*", tensor.data_ptr()))
        if windows:  # frames, which int32 holds: PyTorch does little with uint32
            tensors["window"] = torch.empty((n, 2), dtype=torch.int32, device=where)
            buffers.window = ffi.cast("uint32_t*", tensors["window"].data_ptr())
        workspace = torch.empty(request.workspace_bytes, dtype=torch.uint8, device=where)
        stream = torch.cuda.current_stream(where).cuda_stream
        check(lib.l4d_cuda_decoder_decode(cuda, buffers, ffi.cast("void*", workspace.data_ptr()),
                                          request.workspace_bytes, ffi.cast("void*", stream)))
        check(lib.l4d_cuda_decoder_finish(cuda))
    finally:
        ffi.release(cuda)
    return tensors
