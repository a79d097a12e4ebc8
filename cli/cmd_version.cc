// SPDX-License-Identifier: Apache-2.0
#include "cli/common.h"
#include "cli/units.h"

namespace l4d::cli {
namespace {

Outcome run_version(Context&) {
  const std::string bitstream = format("%d.%d", L4D_BITSTREAM_MAJOR, L4D_BITSTREAM_MINOR);
  Outcome outcome;
  outcome.json = {{"schema", "l4dcodec.version/1"},   {"version", l4d_version_string()},
                  {"bitstream", bitstream},           {"build", l4d_build_info()},
                  {"backends", {"reference", "cpu"}}, {"cli11", CLI11_VERSION}};
  outcome.text = format("l4dcodec %s\nbitstream %s\n%s\n", l4d_version_string(), bitstream.c_str(),
                        l4d_build_info());
  return outcome;
}

}  // namespace

void add_version(Registry& registry) {
  add_verb(registry, "version", "Print the versions of tool, library and bitstream", run_version);
}

}  // namespace l4d::cli
