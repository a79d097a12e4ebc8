// SPDX-License-Identifier: Apache-2.0
// The tables of a layer's rANS pages: contexts with like statistics share one.
#pragma once

#include <vector>

#include "libl4dcodec/container/page.h"
#include "libl4dcodec/entropy/rans_encoder.h"

namespace l4d {

// How often each token occurs in each context of each channel.
class TokenCounts : public ChannelVisitor {
 public:
  explicit TokenCounts(const std::vector<ChannelSpec>& channels);
  void visit(const ChannelSymbols& symbols) override;
  void add(const TokenCounts& other);
  static constexpr size_t kTokens = 128;  // above both kRansHybridTokens and kRansWideTokens

 private:
  friend class EntropyModel;
  std::vector<size_t> first_;     // of each channel, in contexts
  std::vector<uint64_t> counts_;  // [contexts, kTokens]
};

class EntropyModel {
 public:
  EntropyModel(const std::vector<ChannelSpec>& channels, const TokenCounts& counts);

  // The chunk that parse_entropy_tables reads.
  Bytes serialize() const;
  // One page: its base chunk, and in *detail its SH chunk; all channels in the first where that is
  // null or the second would have fewer bytes than `min_detail`, or no channel.
  Bytes encode_page(const SceneHeader& header, const LayerHeader& layer, const PageColumns& columns,
                    Bytes* detail, size_t min_detail = 0) const;

 private:
  void cluster(const TokenCounts& counts, const std::vector<size_t>& contexts, size_t max_tables);

  const std::vector<ChannelSpec> channels_;
  std::vector<RansTable> tables_;  // those of wide integers first
  size_t wide_tables_ = 0;
  std::vector<size_t> first_;  // of each channel, in contexts
  std::vector<uint8_t> map_;   // [contexts]
};

}  // namespace l4d
