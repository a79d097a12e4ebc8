// SPDX-License-Identifier: Apache-2.0
// The document that the sections of a run become.
#pragma once

#include <string>

#include "bench/accuracy/bench.h"

namespace l4d::bench {

// The document as text: a key a line, and a row of a table a line, so that a row that changes is
// one changed line.
std::string text_of(const Json& document);
// Writes it in place of what is there. Throws io::Error.
void write_document(const std::string& path, const Json& document);

}  // namespace l4d::bench
