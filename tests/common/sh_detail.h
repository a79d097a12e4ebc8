// SPDX-License-Identifier: Apache-2.0
// Files whose pages have an SH chunk, be they as small as they may: an encoder splits large ones.
#pragma once

#include <functional>

#include "tests/common/stream_editor.h"

namespace l4d::test {

// Codes the rANS pages of a file anew, with SH detail in an SH chunk of each. `edit` may change
// the columns of each page before.
Bytes with_sh_detail(const Bytes& file, unsigned sh_base,
                     const std::function<void(PageColumns&)>& edit = nullptr);

// The records of all pages, in stored order, with offsets in the file.
std::vector<PageRecord> page_records(const Bytes& file);

}  // namespace l4d::test
