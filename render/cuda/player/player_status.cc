// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/player/player_status.h"

#include "l4d/playback.h"

namespace l4d::render {

Status status_of_cause(uint32_t cause) {
  switch (cause) {
    case L4D_CAUSE_GARBLED:
    case L4D_CAUSE_DAMAGED:
      return Status(L4D_ERR_CHECKSUM, "stored bytes that the instant needs are damaged");
    case L4D_CAUSE_TRUNCATED:
      return Status(L4D_ERR_TRUNCATED, "the file ends before bytes that it refers to");
    case L4D_CAUSE_CORRUPT:
      return Status(L4D_ERR_CORRUPT, "the stream breaks a rule of the specification");
    case L4D_CAUSE_NOT_L4D:
      return Status(L4D_ERR_NOT_L4D, "this is no L4D file");
    case L4D_CAUSE_VERSION:
      return Status(L4D_ERR_VERSION_UNSUPPORTED, "a version that this library does not read");
    case L4D_CAUSE_FEATURE:
      return Status(L4D_ERR_FEATURE_UNSUPPORTED, "the stream needs a tool that is not known");
    case L4D_CAUSE_LIMIT:
      return Status(L4D_ERR_LIMIT_EXCEEDED,
                    "max_units or the memory of the engine is too small for this instant");
    case L4D_CAUSE_CHANGED:
      return Status(L4D_ERR_IO, "the file has changed: create another player");
    default:
      return Status(L4D_ERR_IO, "the reader or the link fails");
  }
}

}  // namespace l4d::render
