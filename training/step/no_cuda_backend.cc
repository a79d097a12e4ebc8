// SPDX-License-Identifier: Apache-2.0
// In builds without device code.
#include "l4d/l4d.hpp"
#include "training/step/cuda_backend.h"

namespace l4d::train {

std::unique_ptr<Backend> make_cuda_backend(uint32_t device) { return make_cuda_group({device}); }

std::unique_ptr<Backend> make_cuda_group(const std::vector<uint32_t>&, Transport) {
  throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
              "this build has no device code: use another backend, or build with L4D_CUDA=ON");
}

bool has_cuda_backend() { return false; }

}  // namespace l4d::train
