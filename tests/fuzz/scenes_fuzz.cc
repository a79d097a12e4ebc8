// SPDX-License-Identifier: Apache-2.0
// Scenes of other formats than PLY: SPZ, SOG, glTF, .splatv and .4dgs by their first bytes, else
// .splat where the length allows it, else KSPLAT.
#include <cstdlib>
#include <cstring>
#include <string>

#include "io/formats/scene_file.h"
#include "tests/fuzz/file_in_memory.h"

namespace {

// Images and counts beyond that only measure the allocator.
constexpr uint64_t kMemory = uint64_t{64} << 20;

bool begins(const uint8_t* data, size_t size, const char* magic) {
  const size_t length = std::strlen(magic);
  return size >= length && std::memcmp(data, magic, length) == 0;
}

std::string name_for(const uint8_t* data, size_t size) {
  if (begins(data, size, "NGSP") || begins(data, size, "\x1f\x8b")) return "a.spz";
  if (begins(data, size, "PK")) return "a.sog";
  if (begins(data, size, "Kg")) return "a.splatv";
  if (begins(data, size, "glTF")) return "a.glb";
  if (begins(data, size, "{")) return "a.gltf";
  if (begins(data, size,
             "\x89"
             "4DGS"))
    return "a.4dgs";
  return size % 32 == 0 ? "a.splat" : "a.ksplat";
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const l4d::fuzz::FileInMemory file(data, size);
  const l4d::io::MemoryBudget budget("the fuzzer's limit", kMemory);
  l4d::io::ImportOptions options;
  options.holder = budget.holder();
  try {
    const std::string name = name_for(data, size);
    if (!l4d::io::is_scene_file(file.path(), name)) return 0;
    const l4d::io::Scene scene = l4d::io::read_scene_file(file.path(), name, options);
    const size_t n = scene.count();
    if (scene.sh_degree > 3 || scene.position.size() != 3 * n || scene.rotor.size() != 8 * n ||
        scene.sh.size() != 3 * scene.sh_coefficients() * n) {
      std::abort();
    }
  } catch (const l4d::io::Error& error) {
    if (error.status() == L4D_ERR_INTERNAL) std::abort();
  }
  if (budget.held() != 0) std::abort();
  return 0;
}
