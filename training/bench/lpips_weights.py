#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the weights of LPIPS for `--lpips FILE`, from the Python package of its authors.

usage: lpips_weights.py alex|vgg FILE.safetensors

Needs the packages lpips, safetensors, torch and torchvision. The first use downloads the network.
"""

import re
import sys

import lpips
import safetensors.torch

if len(sys.argv) != 3 or sys.argv[1] not in ("alex", "vgg"):
    sys.exit(__doc__)
tensors = {}
for name, tensor in lpips.LPIPS(net=sys.argv[1], version="0.1").state_dict().items():
    name = re.sub(r"^net\.slice\d\.", "features.", name)  # the slices keep the numbers of layers
    if re.match(r"features\.\d+\.|lin\d\.model\.1\.", name):
        tensors[name] = tensor.float().contiguous()
safetensors.torch.save_file(tensors, sys.argv[2])
