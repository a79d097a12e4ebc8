// SPDX-License-Identifier: Apache-2.0
// The tables of a layer's rANS pages: contexts with like statistics share one.
#pragma once

#include <vector>

#include "libl4dcodec/container/page.h"
#include "libl4dcodec/entropy/rans_encoder.h"

namespace l4d {

// How often each token occurs in each context of each plane.
class TokenCounts : public PlaneVisitor {
 public:
  explicit TokenCounts(const std::vector<PlaneSpec>& planes);
  void visit(const PlaneSymbols& symbols) override;
  void add(const TokenCounts& other);

 private:
  friend class EntropyModel;
  static constexpr size_t kTokens = 128;  // above both kRansHybridTokens and kRansWideTokens
  std::vector<size_t> first_;             // of each plane, in contexts
  std::vector<uint64_t> counts_;          // [contexts, kTokens]
};

class EntropyModel {
 public:
  EntropyModel(const std::vector<PlaneSpec>& planes, const TokenCounts& counts);

  // The chunk that parse_entropy_tables reads.
  Bytes serialize() const;
  // One page: its first part, and in *detail its second; all planes in the first where that is null
  // or the second would have fewer bytes than `least_detail`, or no plane.
  Bytes encode_page(const SceneHeader& header, const LayerHeader& layer, const PageColumns& columns,
                    Bytes* detail, size_t least_detail = 0) const;

 private:
  void cluster(const TokenCounts& counts, const std::vector<size_t>& contexts, size_t max_tables);

  const std::vector<PlaneSpec> planes_;
  std::vector<RansTable> tables_;  // those of wide integers first
  size_t wide_tables_ = 0;
  std::vector<size_t> first_;  // of each plane, in contexts
  std::vector<uint8_t> map_;   // [contexts]
};

}  // namespace l4d
