// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/container/levels.h"

namespace l4d {
namespace {

constexpr const char* kProfileNames[] = {"none", "indexed", "main", "lossless"};
constexpr const char* kComponentNames[] = {"sh", "scale", "rotor_spatial", "rotor_temporal"};

constexpr uint64_t kMiB = uint64_t{1} << 20;
constexpr LevelLimits kLevels[kNumConformanceLevels] = {
    {"phone", 100000, 32 * kMiB, 4 * kMiB, 8 * kMiB, 2 * kMiB, 4 * kMiB, 64 * kMiB, 6400000,
     3200000},
    {"headset", 250000, 48 * kMiB, 8 * kMiB, 16 * kMiB, 4 * kMiB, 8 * kMiB, 128 * kMiB, 16000000,
     8000000},
    {"laptop", 500000, 64 * kMiB, 16 * kMiB, 32 * kMiB, 8 * kMiB, 16 * kMiB, 256 * kMiB, 32000000,
     16000000},
    {"desktop", 1000000, 128 * kMiB, 32 * kMiB, 64 * kMiB, 16 * kMiB, 32 * kMiB, 512 * kMiB,
     64000000, 32000000},
    {"workstation", 2500000, 256 * kMiB, 96 * kMiB, 192 * kMiB, 48 * kMiB, 96 * kMiB, 1024 * kMiB,
     160000000, 80000000},
    {"studio", 8000000, 512 * kMiB, 256 * kMiB, 512 * kMiB, 128 * kMiB, 256 * kMiB, 3072 * kMiB,
     512000000, 256000000},
};

// The first property of a stream that a profile forbids.
class Violation {
 public:
  void raw(bool is_raw, const std::string& what) { note(is_raw, what, "is raw32"); }
  void not_raw(bool is_raw, const std::string& what) { note(!is_raw, what, "is not raw32"); }
  void note(bool broken, const std::string& what, const char* how) {
    if (broken && text_.empty()) text_ = what + " " + how;
  }
  std::string take() { return std::move(text_); }

 private:
  std::string text_;
};

bool is_raw(const ScalarCoding& c) { return c.coding == ScalarCodingId::kRaw32; }
bool is_raw(const ComponentCoding& c) { return c.coding == ComponentCodingId::kRaw32; }
bool is_raw(CoordinateCodingId c) {
  return c == CoordinateCodingId::kRaw32 || c == CoordinateCodingId::kRaw64;
}

std::string lossless_violation(const SceneHeader& h) {
  Violation b;
  b.not_raw(is_raw(h.position), "position");
  b.not_raw(is_raw(h.opacity), "opacity");
  b.not_raw(is_raw(h.sh), "sh");
  for (size_t l = 0; l < h.layers.size(); ++l) {
    const std::string of = " of layer " + std::to_string(l);
    b.not_raw(is_raw(h.layers[l].mean_t) || h.layers[l].flat(), "mean_t" + of);
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      b.not_raw(is_raw(h.layers[l].component[c]), kComponentNames[c] + of);
    }
  }
  return b.take();
}

std::string coded_violation(const SceneHeader& h, bool indexed) {
  Violation b;
  const auto component = [&](const ComponentCoding& c, const std::string& what) {
    b.raw(is_raw(c), what);
    b.note(indexed && c.transform(), what, "is a transform");
  };
  b.raw(is_raw(h.position), "position");
  b.note(indexed && h.position == CoordinateCodingId::kFixed, "position", "is fixed");
  b.raw(is_raw(h.opacity), "opacity");
  component(h.sh, "sh");
  for (size_t l = 0; l < h.layers.size(); ++l) {
    const std::string of = " of layer " + std::to_string(l);
    b.note(indexed && h.layers[l].raw_position, "position" + of, "is raw32");
    if (h.layers[l].raw_position) continue;
    b.raw(is_raw(h.layers[l].mean_t), "mean_t" + of);
    b.note(indexed && h.layers[l].mean_t == CoordinateCodingId::kFixed, "mean_t" + of, "is fixed");
    b.raw(is_raw(h.layers[l].scale_factor), "scale_factor" + of);
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      component(h.layers[l].component[c], kComponentNames[c] + of);
    }
  }
  return b.take();
}

}  // namespace

const char* profile_name(unsigned profile) {
  return profile <= kNumProfiles ? kProfileNames[profile] : nullptr;
}

std::string profile_violation(const SceneHeader& header, ProfileId profile) {
  switch (profile) {
    case ProfileId::kIndexed:
    case ProfileId::kMain:
      return coded_violation(header, profile == ProfileId::kIndexed);
    case ProfileId::kLossless:
      return lossless_violation(header);
    default:
      return {};
  }
}

ProfileId profile_of(const SceneHeader& header) {
  for (const ProfileId p : {ProfileId::kIndexed, ProfileId::kMain, ProfileId::kLossless}) {
    if (profile_violation(header, p).empty()) return p;
  }
  return ProfileId::kNone;
}

bool has_packed_form(const SceneHeader& header) {
  return profile_violation(header, ProfileId::kIndexed).empty();
}

LevelLimits level_limits(unsigned level, bool lossless) {
  LevelLimits limits = kLevels[level - 1];
  if (lossless) {
    for (uint64_t* bytes : {&limits.instant_bytes, &limits.start_bytes, &limits.bytes_per_second,
                            &limits.burst_bytes}) {
      *bytes *= kLosslessBytes;
    }
  }
  return limits;
}

}  // namespace l4d
