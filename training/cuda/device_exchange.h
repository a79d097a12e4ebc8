// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "libl4dcodec/base/status.h"
#include "training/step/cuda_backend.h"
#include "training/step/exchange.h"

namespace l4d::train {

// Fails unless there are 1 to 8 devices and they are of one kind: models of members stay equal only
// if their devices round alike.
Status check_devices(const std::vector<uint32_t>& devices);

// Of members on these devices, in their order. Each member adds a part of the rows up and gives it
// to all. Only rows in use travel.
Status make_device_exchange(const std::vector<uint32_t>& devices, Transport transport,
                            std::unique_ptr<Exchange>* out);

}  // namespace l4d::train
