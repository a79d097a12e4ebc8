// SPDX-License-Identifier: Apache-2.0
#include "eval/pairing.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <unordered_map>

#include "eval/motion.h"
#include "eval/nearest.h"
#include "eval/parallel.h"
#include "io/file/file.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::eval {
namespace {

// The attributes of one Gaussian as pieces of memory, for hashing and comparing bit for bit.
class Rows {
 public:
  explicit Rows(const io::Scene& scene) : scene_(scene) {
    for_each_attribute(
        [&](const AttributeInfo& a, const std::vector<float>& rows) {
          // Times are compared as doubles.
          if (a.flag == info_of(Attribute::kMeanTime).flag) return;
          pieces_.push_back({rows.data(), a.numbers(scene.sh_degree)});
        },
        scene);
  }

  uint64_t hash(size_t index) const {
    uint64_t h = 0x9e3779b97f4a7c15u ^ time_bits(index);
    for (const Piece& piece : pieces_) {
      for (size_t i = 0; i < piece.width; ++i) {
        uint32_t bits;
        std::memcpy(&bits, piece.data + index * piece.width + i, sizeof(bits));
        h = (h ^ bits) * 0xff51afd7ed558ccdu;
        h ^= h >> 32;
      }
    }
    return h;
  }
  bool equal(size_t index, const Rows& other, size_t other_index) const {
    if (time_bits(index) != other.time_bits(other_index)) return false;
    for (size_t p = 0; p < pieces_.size(); ++p) {
      const size_t width = pieces_[p].width;
      if (std::memcmp(pieces_[p].data + index * width, other.pieces_[p].data + other_index * width,
                      width * sizeof(float)) != 0) {
        return false;
      }
    }
    return true;
  }

 private:
  struct Piece {
    const float* data;
    size_t width;
  };
  // In full: a float32 may stand for a double.
  uint64_t time_bits(size_t index) const {
    const double time = scene_.mean_time(index);
    uint64_t bits;
    std::memcpy(&bits, &time, sizeof(bits));
    return bits;
  }
  const io::Scene& scene_;
  std::vector<Piece> pieces_;
};

bool rows_comparable(const io::Scene& a, const io::Scene& b) {
  return a.sh_degree == b.sh_degree && a.flags == b.flags;
}

void pair_equal_rows(const io::Scene& a, const io::Scene& b, Pairing& pairing,
                     std::vector<bool>& a_taken) {
  const Rows rows_a(a);
  const Rows rows_b(b);
  std::unordered_multimap<uint64_t, uint32_t> by_hash;
  by_hash.reserve(a.count());
  for (size_t i = a.count(); i-- > 0;) by_hash.emplace(rows_a.hash(i), static_cast<uint32_t>(i));
  for (size_t i = 0; i < b.count(); ++i) {
    const auto [begin, end] = by_hash.equal_range(rows_b.hash(i));
    for (auto it = begin; it != end; ++it) {
      if (!rows_b.equal(i, rows_a, it->second)) continue;
      pairing.a_of_b[i] = it->second;
      a_taken[it->second] = true;
      ++pairing.matched;
      ++pairing.equal_rows;
      by_hash.erase(it);
      break;
    }
  }
}

// What coding keeps well weighs most. Positions are good to 1e-3 of the scene, so the other
// features decide only between Gaussians that lie as close together as that. The weights are those
// that paired most of a trained scene right.
constexpr float kTimeWeight = 0.05f;
constexpr float kOpacityWeight = 0.05f;
constexpr float kSizeWeight = 0.02f;
constexpr float kColourWeight = 0.01f;

std::vector<Feature> features_of(const io::Scene& scene, const l4d_timeline& timeline,
                                 uint32_t threads) {
  std::vector<Feature> features(scene.count());
  const double begin = timeline.time_begin;
  const double duration = io::duration(timeline);
  const size_t sh_stride = 3 * scene.sh_coefficients();
  for_each_block(scene.count(), threads, [&](size_t, size_t first, size_t last) {
    for (size_t i = first; i < last; ++i) {
      const Motion motion = motion_of(scene, i);
      VisibleSpan span = visible_span(motion, begin, begin + duration);
      if (span.empty()) span.begin = span.end = std::clamp(motion.mean_t, begin, begin + duration);
      const double middle = (span.begin + span.end) / 2;
      const io::Vec3 position = motion.at(middle);
      const double size2 = motion.covariance[0] + motion.covariance[3] + motion.covariance[5];
      Feature& f = features[i];
      for (size_t k = 0; k < 3; ++k) f[k] = static_cast<float>(position[k]);
      f[3] = kTimeWeight * static_cast<float>((middle - begin) / duration);
      f[4] = kTimeWeight * static_cast<float>((span.end - span.begin) / duration);
      // With its falloff: coding trades the one for the other.
      f[5] = kOpacityWeight * static_cast<float>(linear_opacity(scene, i) *
                                                 falloff(motion.lambda, middle - motion.mean_t));
      f[6] = kSizeWeight * static_cast<float>(0.25 * std::log(size2 + 1e-30));
      for (size_t k = 0; k < 3; ++k) f[7 + k] = kColourWeight * scene.sh[i * sh_stride + k];
      for (float& value : f) {
        if (!std::isfinite(value)) value = 0;
      }
    }
  });
  return features;
}

// Half of the distance between the 10th and the 90th percentile along the widest axis: outliers far
// out do not matter.
float spatial_spread(const std::vector<Feature>& features) {
  float spread = 0;
  std::vector<float> values(features.size());
  for (size_t k = 0; k < 3; ++k) {
    for (size_t i = 0; i < features.size(); ++i) values[i] = features[i][k];
    const auto percentile = [&](size_t tenth) {
      const auto nth =
          values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) * tenth / 10);
      std::nth_element(values.begin(), nth, values.end());
      return *nth;
    };
    const float low = percentile(1);
    spread = std::max(spread, (percentile(9) - low) / 2);
  }
  return spread > 0 ? spread : 1;
}

struct Candidate {
  float distance2;
  uint32_t a, b;
  bool operator<(const Candidate& o) const {
    if (distance2 != o.distance2) return distance2 < o.distance2;
    return a != o.a ? a < o.a : b < o.b;
  }
};

// Greedy one-to-one matching: candidates by rising distance; who finds all of theirs taken asks for
// more in the next round.
void pair_nearest(const io::Scene& a, const io::Scene& b, uint32_t threads,
                  const Observer& observer, Pairing& pairing, std::vector<bool>& a_taken) {
  std::vector<Feature> features_a = features_of(a, a.timeline, threads);
  std::vector<Feature> features_b = features_of(b, a.timeline, threads);
  const float scale = 1 / spatial_spread(features_a);
  for (std::vector<Feature>* features : {&features_a, &features_b}) {
    for (Feature& f : *features) {
      for (size_t k = 0; k < 3; ++k) f[k] *= scale;
    }
  }
  constexpr size_t kRounds = 12;
  constexpr size_t kMaxCandidates = 128;
  size_t k = 4;
  for (size_t round = 0; round < kRounds; ++round) {
    std::vector<uint32_t> free_a;
    for (uint32_t i = 0; i < a.count(); ++i) {
      if (!a_taken[i]) free_a.push_back(i);
    }
    std::vector<uint32_t> free_b;
    for (uint32_t i = 0; i < b.count(); ++i) {
      if (pairing.a_of_b[i] == kUnmatched) free_b.push_back(i);
    }
    if (free_a.empty() || free_b.empty()) return;
    const NearestTree tree(features_a, std::move(free_a));
    std::vector<std::vector<Candidate>> found(num_blocks(free_b.size()));
    for_each_block(free_b.size(), threads, [&](size_t block, size_t first, size_t last) {
      observer.check();
      std::vector<Neighbour> neighbours;
      for (size_t i = first; i < last; ++i) {
        tree.query(features_b[free_b[i]], k, neighbours);
        for (const Neighbour& n : neighbours) {
          found[block].push_back({n.distance2, n.index, free_b[i]});
        }
      }
    });
    std::vector<Candidate> candidates;
    for (const auto& block : found) candidates.insert(candidates.end(), block.begin(), block.end());
    std::sort(candidates.begin(), candidates.end());
    for (const Candidate& c : candidates) {
      if (a_taken[c.a] || pairing.a_of_b[c.b] != kUnmatched) continue;
      a_taken[c.a] = true;
      pairing.a_of_b[c.b] = c.a;
      ++pairing.matched;
    }
    k = std::min(2 * k, kMaxCandidates);
  }
}

Pairing empty_pairing(const io::Scene& a, const io::Scene& b) {
  if (std::max(a.count(), b.count()) >= kUnmatched) {
    throw io::Error(L4D_ERR_LIMIT_EXCEEDED, "compare takes fewer than 2^32 - 1 Gaussians");
  }
  Pairing pairing;
  pairing.a_of_b.assign(b.count(), kUnmatched);
  return pairing;
}

}  // namespace

Pairing pair_by_order(const io::Scene& a, const io::Scene& b, const std::vector<uint32_t>& order) {
  Pairing pairing = empty_pairing(a, b);
  pairing.match = "order";
  if (order.size() != b.count()) {
    throw io::Error(L4D_ERR_INVALID_ARGUMENT, "the order has " + std::to_string(order.size()) +
                                                  " entries, B has " + std::to_string(b.count()) +
                                                  " Gaussians");
  }
  std::vector<bool> seen(a.count());
  const Rows rows_a(a);
  const Rows rows_b(b);
  const bool comparable = rows_comparable(a, b);
  for (size_t i = 0; i < order.size(); ++i) {
    if (order[i] >= a.count() || seen[order[i]]) {
      throw io::Error(L4D_ERR_INVALID_ARGUMENT, "the order is not one of A's Gaussians: entry " +
                                                    std::to_string(i) + " is " +
                                                    std::to_string(order[i]));
    }
    seen[order[i]] = true;
    pairing.a_of_b[i] = order[i];
    ++pairing.matched;
    if (comparable && rows_b.equal(i, rows_a, order[i])) ++pairing.equal_rows;
  }
  return pairing;
}

Pairing pair_by_content(const io::Scene& a, const io::Scene& b, uint32_t threads,
                        const Observer& observer) {
  Pairing pairing = empty_pairing(a, b);
  std::vector<bool> a_taken(a.count());
  if (rows_comparable(a, b)) pair_equal_rows(a, b, pairing, a_taken);
  pairing.match = "exact";
  if (pairing.matched < std::min(a.count(), b.count())) {
    pairing.match = "nearest";
    pair_nearest(a, b, threads, observer, pairing, a_taken);
  }
  return pairing;
}

std::vector<uint32_t> read_order(const std::string& path) {
  const std::vector<uint8_t> bytes = io::read_whole_file(path);
  if (bytes.size() % 4 != 0) {
    throw io::Error(L4D_ERR_CORRUPT, path + ": an order file is a whole number of 4-byte integers");
  }
  std::vector<uint32_t> order(bytes.size() / 4);
  for (size_t i = 0; i < order.size(); ++i) {
    const uint8_t* p = bytes.data() + 4 * i;
    order[i] = static_cast<uint32_t>(p[0]) | static_cast<uint32_t>(p[1]) << 8 |
               static_cast<uint32_t>(p[2]) << 16 | static_cast<uint32_t>(p[3]) << 24;
  }
  return order;
}

void write_order(const std::string& path, const std::vector<uint32_t>& order) {
  std::vector<uint8_t> bytes(4 * order.size());
  for (size_t i = 0; i < order.size(); ++i) {
    for (unsigned k = 0; k < 4; ++k) bytes[4 * i + k] = static_cast<uint8_t>(order[i] >> (8 * k));
  }
  io::OutputFile file(path);
  file.write(bytes.data(), bytes.size());
  file.commit();
}

}  // namespace l4d::eval
