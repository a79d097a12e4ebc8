// SPDX-License-Identifier: Apache-2.0
// SH chunks for pages whose own is lost.
#pragma once

#include "decoder/read/plan.h"
#include "libl4dcodec/base/bytes.h"

namespace l4d {

// Codes an SH chunk for a page of which the base chunk is right. With it the page decodes to what
// decoders show that lack the SH chunk (spec: DEC-7), or as near to that as the layer's tables can
// say: each coefficient of SH detail is the least for which there is a code, which nearly always is
// 0. *out stays empty where SH has no base, so that the lost chunk has more than coefficients.
// Fails as decoders of the base chunk do.
Status make_blank_detail(SceneFile& file, const PageTask& task, Bytes* out);

}  // namespace l4d
