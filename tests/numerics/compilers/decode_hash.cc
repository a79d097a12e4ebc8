// SPDX-License-Identifier: Apache-2.0
// decode_hash --targets: the SIMD targets of this build that the machine has, and "reference".
// decode_hash TARGET FILE...: decodes with 1, 2 and 7 threads, with and without flush-to-zero, and
// prints a line "FILE TARGET THREADS FTZ HASH-OF-GAUSSIANS HASH-OF-SLICES" for each.
#include <hwy/highway.h>
#include <hwy/targets.h>

#include <cinttypes>
#include <cstdio>
#include <cstring>
#include <optional>
#include <string>
#include <vector>

#include "l4d/l4d.hpp"
#include "libl4dcodec/base/hash.h"
#include "tests/common/flush_to_zero.h"

namespace {

constexpr char kReference[] = "reference";

uint64_t mix(uint64_t h, const void* data, size_t size) {
  const auto* bytes = static_cast<const unsigned char*>(data);
  return h * 0x9e3779b97f4a7c15u + l4d::hash64(l4d::ByteSpan(bytes, size));
}
uint64_t mix(uint64_t h, const std::vector<float>& v) {
  return mix(h, v.data(), v.size() * sizeof(float));
}

uint64_t hash_gaussians(const l4d::DecoderHandle& d) {
  l4d_query all = L4D_INIT(l4d_query);
  const l4d::GaussianArrays a = d.decode(all);
  uint64_t h = a.count();
  for (const auto* v :
       {&a.position, &a.mean_t, &a.mean_t_local, &a.log_scale, &a.rotor, &a.opacity, &a.sh}) {
    h = mix(h, *v);
  }
  return h;
}

uint64_t hash_slices(const l4d::DecoderHandle& d) {
  const l4d_info info = d.info();
  uint64_t h = 0;
  for (const double share : {0.0, 0.123, 0.5, 0.77, 1.0}) {
    const l4d::SplatArrays s = d.slice(info.timeline.time_begin + share * info.duration);
    for (const auto* v : {&s.position, &s.covariance, &s.opacity, &s.sh}) h = mix(h, *v);
  }
  return h;
}

int64_t target_of(const char* name) {
  for (int64_t rest = HWY_TARGETS; rest != 0; rest &= rest - 1) {
    if (std::strcmp(hwy::TargetName(rest & -rest), name) == 0) return rest & -rest;
  }
  return 0;
}

void run(const char* target, const char* path, uint32_t threads, bool flush) {
  std::optional<l4d::test::FlushToZero> flushed;
  if (flush) flushed.emplace();
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  options.threads = threads;
  options.backend = std::strcmp(target, kReference) == 0 ? L4D_BACKEND_REFERENCE : L4D_BACKEND_CPU;
  l4d::DecoderHandle d(&options);
  d.open_file(path);
  const std::string name(path);
  std::printf("%s %s %u %s %016" PRIx64 " %016" PRIx64 "\n",
              name.substr(name.rfind('/') + 1).c_str(), target, threads, flush ? "on" : "off",
              hash_gaussians(d), hash_slices(d));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::strcmp(argv[1], "--targets") == 0) {
    std::printf("%s\n", kReference);
    for (int64_t rest = HWY_TARGETS & hwy::SupportedTargets(); rest != 0; rest &= rest - 1) {
      std::printf("%s\n", hwy::TargetName(rest & -rest));
    }
    return 0;
  }
  if (argc < 3) return 2;
  if (std::strcmp(argv[1], kReference) != 0) {
    const int64_t target = target_of(argv[1]);
    if ((hwy::SupportedTargets() & target) == 0) return 2;
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
  try {
    for (int i = 2; i < argc; ++i) {
      for (const uint32_t threads : {1u, 2u, 7u}) {
        for (const bool flush : {false, true}) run(argv[1], argv[i], threads, flush);
      }
    }
  } catch (const l4d::Error& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 1;
  }
  return 0;
}
