// SPDX-License-Identifier: Apache-2.0
#include "eval/pair/pairing.h"

#include <algorithm>
#include <cstring>
#include <unordered_map>

#include "eval/pair/stated_pairing.h"
#include "io/file/file.h"

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

void pair_equal_rows(const io::Scene& a, const io::Scene& b, Pairing& pairing) {
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
      ++pairing.matched;
      ++pairing.equal_rows;
      by_hash.erase(it);
      break;
    }
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

Pairing pair_by_content(const io::Scene& a, const DecodedScene& b, uint32_t threads,
                        const std::vector<float>& min_sizes, const DecodedScene* stream_a,
                        const Observer& observer) {
  Pairing pairing = empty_pairing(a, b.scene);
  if (rows_comparable(a, b.scene)) pair_equal_rows(a, b.scene, pairing);
  pairing.match = "exact";
  if (pairing.matched == std::min(a.count(), b.scene.count())) return pairing;
  if (pair_as_stated(PairMeter(a, b, min_sizes, stream_a), b.stated, threads, observer, &pairing)) {
    return pairing;
  }
  pairing.match = "unknown";
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
