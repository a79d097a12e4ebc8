// SPDX-License-Identifier: Apache-2.0
// Failures of the C API as Status.
#pragma once

#include "libl4dcodec/base/status.h"

namespace l4d::render {

// What the last call on this thread returned, with its message.
inline Status told(l4d_status status) {
  if (status == L4D_OK) return {};
  const char* const detail = l4d_last_error_message();
  return Status(status, *detail != 0 ? detail : l4d_status_name(status));
}

// Why the engine of playback.h cannot show an instant.
Status status_of_cause(uint32_t cause);

}  // namespace l4d::render
