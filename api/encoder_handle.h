// SPDX-License-Identifier: Apache-2.0
// What an l4d_encoder is, for the entry points that take one.
#pragma once

#include "encoder/encoder.h"
#include "libl4dcodec/base/c_api.h"

struct l4d_encoder {
  explicit l4d_encoder(const l4d_encoder_options& options) : impl(options) {}
  l4d::Encoder impl;
  mutable l4d::api::Busy busy;
};
