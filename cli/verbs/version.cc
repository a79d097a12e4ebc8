// SPDX-License-Identifier: Apache-2.0
#include <CLI/Version.hpp>
#include <cstring>

#include "cli/command/context.h"
#include "cli/text/units.h"
#include "cli/verbs/verbs.h"
#include "l4d/cuda.hpp"

namespace l4d::cli {
namespace {

Outcome run_version(Context&) {
  const std::string bitstream = format("%d.%d", L4D_BITSTREAM_MAJOR, L4D_BITSTREAM_MINOR);
  Outcome outcome;
  Json backends = {"reference", "cpu"};
  if (std::strstr(l4d_build_info(), "; cuda") != nullptr) backends.push_back("cuda");
  Json devices = Json::array();
  std::string device_text;
  const std::vector<l4d_cuda_device_info> all = cuda_devices();
  for (size_t i = 0; i < all.size(); ++i) {
    const l4d_cuda_device_info& info = all[i];
    if (info.name[0] == 0) continue;  // it cannot be asked
    devices.push_back(
        {{"index", i},
         {"name", info.name},
         {"compute_capability", format("%u.%u", info.compute_major, info.compute_minor)},
         {"multiprocessors", info.multiprocessors},
         {"memory_bytes", info.memory_bytes},
         {"usable", info.usable != 0}});
    device_text +=
        format("device %zu: %s, %s%s\n", i, info.name, format_bytes(info.memory_bytes).c_str(),
               info.usable != 0 ? "" : " (this build has no code for it)");
  }
  outcome.json = {{"schema", "l4dcodec.version/1"}, {"version", l4d_version_string()},
                  {"bitstream", bitstream},         {"build", l4d_build_info()},
                  {"backends", backends},           {"devices", devices},
                  {"cli11", CLI11_VERSION}};
  outcome.text = format("l4dcodec %s\nbitstream %s\n%s\n", l4d_version_string(), bitstream.c_str(),
                        l4d_build_info()) +
                 device_text;
  return outcome;
}

}  // namespace

void add_version(Registry& registry) {
  add_verb(registry, "version", "Print the versions of tool, library and bitstream", run_version);
}

}  // namespace l4d::cli
