// SPDX-License-Identifier: Apache-2.0
#include "encoder/file/entropy_model.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace l4d {
namespace {

// What a token takes that a cluster has not seen, in counts.
constexpr double kUnseen = 0.02;
// Bits of a table in the stream: about ten for each token that has a frequency.
constexpr double kBitsPerToken = 10;
constexpr int kRounds = 3;

// Of one cluster: bits of each token.
struct Costs {
  std::vector<float> bits;
  explicit Costs(const std::vector<double>& counts) : bits(counts.size()) {
    const double total = std::accumulate(counts.begin(), counts.end(), 0.0) +
                         kUnseen * static_cast<double>(counts.size());
    for (size_t t = 0; t < counts.size(); ++t) {
      bits[t] = static_cast<float>(-std::log2((counts[t] + kUnseen) / total));
    }
  }
};

// The tokens that occur in a context, and how often.
struct Histogram {
  std::vector<std::pair<uint16_t, float>> tokens;
  double total = 0;
  double entropy = 0;  // bits of all

  double cost(const Costs& costs) const {
    double sum = 0;
    for (const auto& [token, count] : tokens) {
      sum += static_cast<double>(count) * static_cast<double>(costs.bits[token]);
    }
    return sum;
  }
};

Histogram histogram_of(const uint64_t* count /* [kTokens] */) {
  Histogram h;
  for (size_t t = 0; t < TokenCounts::kTokens; ++t) {
    if (count[t] == 0) continue;
    h.tokens.emplace_back(static_cast<uint16_t>(t), static_cast<float>(count[t]));
    h.total += static_cast<double>(count[t]);
  }
  for (const auto& [token, n] : h.tokens) {
    h.entropy -= static_cast<double>(n) * std::log2(static_cast<double>(n) / h.total);
  }
  return h;
}

void add_tokens(const Histogram& histogram, std::vector<double>* sum) {
  for (const auto& [token, n] : histogram.tokens) (*sum)[token] += static_cast<double>(n);
}

// The tokens of all histograms of a cluster.
std::vector<double> sum_of(const std::vector<Histogram>& histograms,
                           const std::vector<size_t>& owner, size_t cluster) {
  std::vector<double> sum(TokenCounts::kTokens, 0.0);
  for (size_t i = 0; i < histograms.size(); ++i) {
    if (owner[i] == cluster) add_tokens(histograms[i], &sum);
  }
  return sum;
}

// Farthest first: the histogram that would gain most by a table of its own gets one, as long as
// that is more than the table takes. Returns the number of clusters, and which one each is in.
size_t seed_clusters(const std::vector<Histogram>& histograms, size_t max_tables,
                     std::vector<size_t>* owner) {
  owner->assign(histograms.size(), 0);
  const auto costs_of = [](const Histogram& histogram) {
    std::vector<double> seed(TokenCounts::kTokens, 0.0);
    add_tokens(histogram, &seed);
    return Costs(seed);
  };
  Costs costs = costs_of(
      *std::max_element(histograms.begin(), histograms.end(),
                        [](const Histogram& a, const Histogram& b) { return a.total < b.total; }));
  std::vector<double> excess;
  for (const Histogram& h : histograms) excess.push_back(h.cost(costs) - h.entropy);
  size_t clusters = 1;
  while (clusters < max_tables) {
    const size_t worst =
        static_cast<size_t>(std::max_element(excess.begin(), excess.end()) - excess.begin());
    const double price = kBitsPerToken * static_cast<double>(histograms[worst].tokens.size() + 2);
    if (excess[worst] <= price) break;
    costs = costs_of(histograms[worst]);
    for (size_t i = 0; i < histograms.size(); ++i) {
      const double own = histograms[i].cost(costs) - histograms[i].entropy;
      if (own >= excess[i]) continue;
      excess[i] = own;
      (*owner)[i] = clusters;
    }
    ++clusters;
  }
  return clusters;
}

// Moves each histogram to the cluster whose table codes it best, and that with what it then holds.
void refine_clusters(const std::vector<Histogram>& histograms, size_t clusters,
                     std::vector<size_t>* owner) {
  for (int round = 0; round < kRounds; ++round) {
    std::vector<Costs> all;
    for (size_t k = 0; k < clusters; ++k) all.emplace_back(sum_of(histograms, *owner, k));
    for (size_t i = 0; i < histograms.size(); ++i) {
      double best = HUGE_VAL;
      for (size_t k = 0; k < clusters; ++k) {
        const double cost = histograms[i].cost(all[k]);
        if (cost < best) {
          best = cost;
          (*owner)[i] = k;
        }
      }
    }
  }
}

}  // namespace

TokenCounts::TokenCounts(const std::vector<ChannelSpec>& channels) {
  size_t contexts = 0;
  for (const ChannelSpec& p : channels) {
    first_.push_back(contexts);
    contexts += p.contexts;
  }
  counts_.assign(contexts * kTokens, 0);
}

void TokenCounts::visit(const ChannelSymbols& s) {
  uint64_t* counts = counts_.data() + first_[s.channel] * kTokens;
  for (size_t i = 0; i < s.wide.size(); ++i) ++counts[wide_token(s.wide[i]).token];
  for (size_t i = 0; i < s.hybrid.size(); ++i) {
    const size_t context = s.contexts.empty() ? 0 : s.contexts[i];
    ++counts[context * kTokens + hybrid_token(s.hybrid[i]).token];
  }
}

void TokenCounts::add(const TokenCounts& other) {
  for (size_t i = 0; i < counts_.size(); ++i) counts_[i] += other.counts_[i];
}

EntropyModel::EntropyModel(const std::vector<ChannelSpec>& channels, const TokenCounts& counts)
    : channels_(channels), first_(counts.first_) {
  map_.assign(counts.counts_.size() / TokenCounts::kTokens, 0);
  std::vector<size_t> wide, hybrid;
  for (size_t p = 0; p < channels_.size(); ++p) {
    auto& contexts = channels_[p].kind == ChannelKind::kPosition ? wide : hybrid;
    for (size_t c = 0; c < channels_[p].contexts; ++c) contexts.push_back(first_[p] + c);
  }
  cluster(counts, wide, 1);
  wide_tables_ = tables_.size();
  if (!hybrid.empty()) cluster(counts, hybrid, kMaxEntropyTables - wide_tables_);
}

void EntropyModel::cluster(const TokenCounts& counts, const std::vector<size_t>& contexts,
                           size_t max_tables) {
  constexpr size_t kTokens = TokenCounts::kTokens;
  std::vector<size_t> used;
  std::vector<Histogram> histograms;
  for (const size_t c : contexts) {
    Histogram h = histogram_of(counts.counts_.data() + c * kTokens);
    if (h.tokens.empty()) continue;
    used.push_back(c);
    histograms.push_back(std::move(h));
  }
  for (const size_t c : contexts) map_[c] = static_cast<uint8_t>(tables_.size());
  if (used.empty()) {
    const uint64_t one[] = {1};
    tables_.emplace_back(Span<const uint64_t>(one, 1));
    return;
  }
  std::vector<size_t> owner;
  const size_t clusters = seed_clusters(histograms, max_tables, &owner);
  refine_clusters(histograms, clusters, &owner);
  std::vector<uint8_t> table_of(clusters, 0);
  for (size_t k = 0; k < clusters; ++k) {
    const std::vector<double> sum = sum_of(histograms, owner, k);
    std::vector<uint64_t> exact(kTokens);
    for (size_t t = 0; t < kTokens; ++t) exact[t] = static_cast<uint64_t>(sum[t]);
    while (!exact.empty() && exact.back() == 0) exact.pop_back();
    if (exact.empty()) continue;
    table_of[k] = static_cast<uint8_t>(tables_.size());
    tables_.emplace_back(exact);
  }
  for (size_t i = 0; i < used.size(); ++i) map_[used[i]] = table_of[owner[i]];
}

Bytes EntropyModel::serialize() const {
  Bytes out;
  append_vlq(tables_.size(), out);
  append_vlq(wide_tables_, out);
  for (const RansTable& t : tables_) t.append_to(out);
  out.insert(out.end(), map_.begin(), map_.end());
  return out;
}

namespace {

// Keeps what the block writer borrows until it is done.
class PageCoder : public ChannelVisitor {
 public:
  PageCoder(const std::vector<RansTable>& tables, const std::vector<size_t>& first,
            const std::vector<uint8_t>& map)
      : tables_(tables), first_(first), map_(map) {}

  void visit(const ChannelSymbols& s) override {
    const uint8_t* map = map_.data() + first_[s.channel];
    channels_.push_back({});
    Channel& p = channels_.back();
    p.wide.assign(s.wide.begin(), s.wide.end());
    p.hybrid.assign(s.hybrid.begin(), s.hybrid.end());
    p.tables.resize(s.hybrid.size() + s.wide.size());
    for (size_t i = 0; i < p.tables.size(); ++i)
      p.tables[i] = map[s.contexts.empty() ? 0 : s.contexts[i]];
  }

  void write(size_t begin, size_t end, Bytes& out) const {
    RansBlockWriter writer;
    for (size_t p = begin; p < end; ++p) {
      const Channel& channel = channels_[p];
      if (!channel.wide.empty()) {
        writer.add_wide(tables_.data(), channel.tables.data(), channel.wide);
      } else {
        writer.add_hybrid(tables_.data(), channel.tables.data(), channel.hybrid);
      }
    }
    writer.finish(out);
  }

 private:
  struct Channel {
    std::vector<uint64_t> wide;
    std::vector<uint16_t> hybrid;
    std::vector<uint8_t> tables;
  };
  const std::vector<RansTable>& tables_;
  const std::vector<size_t>& first_;
  const std::vector<uint8_t>& map_;
  std::vector<Channel> channels_;
};

}  // namespace

Bytes EntropyModel::encode_page(const SceneHeader& header, const LayerHeader& layer,
                                const PageColumns& columns, Bytes* detail,
                                size_t min_detail) const {
  PageCoder coder(tables_, first_, map_);
  visit_channels(header, layer, channels_, columns, coder);
  size_t middle = detail == nullptr ? channels_.size() : first_detail_channel(header, channels_);
  if (middle < channels_.size()) {
    coder.write(middle, channels_.size(), *detail);
    if (detail->size() < min_detail) {
      detail->clear();
      middle = channels_.size();
    }
  }
  Bytes out;
  coder.write(0, middle, out);
  return out;
}

}  // namespace l4d
