// SPDX-License-Identifier: Apache-2.0
// What is read before it is wanted, where reads cost more than bytes (l4d_reader.block_bytes). All
// of this only saves reads: what it does not get, the decoder reads later and says why it cannot.
#pragma once

#include "decoder/read/plan.h"
#include "decoder/read/scene_file.h"

namespace l4d {

// Once the headers are known: codebooks and entropy tables, and where it is small the directory.
void fetch_index(SceneFile& file);

// The directory of `query`, if not all of that of `needed` is at hand. `needed` is a part of it.
void fetch_directory(SceneFile& file, const l4d_query& needed, const l4d_query& query);

// The chunks of the wanted spans of a plan, wanted: [plan.spans.size()], and the tables of all.
void fetch_chunks(SceneFile& file, const Plan& plan, const std::vector<bool>& wanted);

// Whether these chunks are at hand.
bool are_chunks_fetched(SceneFile& file, const Plan& plan, const std::vector<bool>& wanted);

}  // namespace l4d
