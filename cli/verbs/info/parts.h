// SPDX-License-Identifier: Apache-2.0
// What `info` reports of a stream, and the parts of its answer.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "cli/input/files.h"
#include "cli/input/member_file.h"
#include "cli/input/scene_source.h"

namespace l4d::cli {

struct InfoArguments {
  std::string input;
  std::string time;
  std::string detail = "full";
  std::string plot;
  ImportArguments import;
};

// What `info` reports of a stream, read once for all parts of the answer.
struct Facts {
  const MemberFile* file;  // nullptr of a PLY
  const SceneStream& stream;
  const Input& input;
  const l4d_info& info;
  const DecoderHandle& decoder;
  std::vector<l4d_layer_info> layers;
  std::vector<uint64_t> sections;
  std::vector<uint64_t> layer_bytes;

  Facts(const MemberFile* members, const SceneStream& given, const Input& from);

  // Whether the input is more than the stream that the report is about.
  bool is_part() const { return file != nullptr && !file->is_plain(); }
  uint64_t bytes() const { return input.is_scene() ? input.bytes() : info.file_bytes; }
  std::string name() const;
};

// "12.3 %"
std::string share_of(uint64_t bytes, uint64_t total);

std::vector<l4d_layer_info> read_layers(const SceneStream& stream);
Json layer_json(const l4d_layer_info& layer, uint64_t bytes);
std::string layer_table(const std::vector<l4d_layer_info>& layers,
                        const std::vector<uint64_t>& layer_bytes);

// Each adds a part to the answer.
void add_file(const Facts& facts, Outcome& outcome);
void add_tools(const Facts& facts, Outcome& outcome);
void add_errors(const Facts& facts, Outcome& outcome);
void add_scalable(const Facts& facts, Outcome& outcome);
void add_seek(Context& context, const Facts& facts, const InfoArguments& arguments,
              Outcome& outcome);

}  // namespace l4d::cli
