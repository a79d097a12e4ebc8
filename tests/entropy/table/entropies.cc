// SPDX-License-Identifier: Apache-2.0
// What the symbols of rANS pages cost now, and what they would cost in contexts that a decoder has
// before them: of the Gaussian before, of the one 32 before (whose state decodes this one), of the
// nearest of those before in the page, and of how opaque the Gaussian is. Costs are those of
// adaptive counts, so that more contexts pay for what they have to learn. Prints a Markdown table.
// usage: l4d_entropies FILE.l4d
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <map>
#include <string>
#include <vector>

#include "libl4dcodec/container/page_columns.h"
#include "libl4dcodec/entropy/rans_encoder.h"
#include "tests/common/stream_editor.h"

namespace {

using namespace l4d;

constexpr size_t kNone = static_cast<size_t>(-1);
constexpr size_t kLanes = 32;

// What tells contexts apart, beside those that the format has.
enum Extra { kNow, kLaneBefore, kGaussianBefore, kNearest, kOpacity, kExtras };
const char* const kNames[kExtras] = {"now", "32 before", "before", "nearest before", "opacity"};

// The bits of tokens of one channel in contexts, each of which learns as it goes.
class AdaptiveCost {
 public:
  double add(unsigned context, unsigned token) {
    Counts& counts = of_[context];
    constexpr double kPrior = 0.05;  // of each token that the channel has
    if (counts.tokens.size() <= token) counts.tokens.resize(token + 1);
    largest_ = std::max(largest_, token + 1);
    const double bits = -std::log2((counts.tokens[token] + kPrior) /
                                   (counts.sum + kPrior * static_cast<double>(largest_)));
    counts.tokens[token] += 1;
    counts.sum += 1;
    return bits;
  }

 private:
  struct Counts {
    std::vector<double> tokens;
    double sum = 0;
  };
  std::map<unsigned, Counts> of_;
  unsigned largest_ = 1;
};

unsigned size_class(uint64_t value) {
  return magnitude_context(static_cast<unsigned>(std::min<uint64_t>(value, 99)));
}

// The Gaussians of a page: who lies near whom, and who is opaque.
struct Neighbours {
  std::vector<size_t> nearest;
  std::vector<unsigned> opacity;

  Neighbours(const PageColumns& page, unsigned opacity_bits)
      : nearest(page.n, kNone), opacity(page.n) {
    const auto place = [&](size_t axis, size_t i) {
      return page.fixed_position[axis].empty() ? static_cast<double>(page.position[axis][i])
                                               : static_cast<double>(page.fixed_position[axis][i]);
    };
    for (size_t i = 0; i < page.n; ++i) {
      double least = HUGE_VAL;
      for (size_t j = 0; j < i; ++j) {
        double square = 0;
        for (size_t axis = 0; axis < 3; ++axis)
          square += std::pow(place(axis, i) - place(axis, j), 2);
        if (square >= least) continue;
        least = square;
        nearest[i] = j;
      }
      opacity[i] =
          page.opacity.empty() ? 0 : page.opacity[i] >> (opacity_bits > 2 ? opacity_bits - 2 : 0);
    }
  }
};

struct Channel {
  std::string name;
  AdaptiveCost cost[kExtras];
  double bits[kExtras] = {};
};

// Counts what each channel costs, page after page.
class Meter : public ChannelVisitor {
 public:
  Meter(const SceneHeader& header, const LayerHeader& layer, const std::vector<ChannelSpec>& specs,
        std::vector<Channel>* channels)
      : header_(header), layer_(layer), specs_(specs), channels_(*channels) {}

  void begin(const PageColumns& page, const Neighbours& near) {
    page_ = &page;
    near_ = &near;
  }

  void visit(const ChannelSymbols& symbols) override {
    const ChannelSpec& spec = specs_[symbols.channel];
    Channel& channel = channels_[symbols.channel];
    const size_t count = std::max(symbols.hybrid.size(), symbols.wide.size());
    const std::vector<size_t> members = members_of(spec, count);
    std::vector<unsigned> sizes(page_->n, 0);
    const bool knows_opacity = spec.kind > ChannelKind::kOpacity;
    for (size_t k = 0; k < count; ++k) {
      const uint64_t value = symbols.wide.empty() ? symbols.hybrid[k] : symbols.wide[k];
      const size_t i = members.empty() ? k : members[k];
      const unsigned given = symbols.contexts.empty() ? 0 : symbols.contexts[k];
      const auto size_at = [&](bool is_there, size_t of) { return is_there ? 1 + sizes[of] : 0; };
      // Of a channel that some Gaussians lack, the one before is that before in the channel.
      const unsigned more[kExtras] = {
          0, size_at(k >= kLanes, members.empty() ? k - kLanes : members[k - std::min(k, kLanes)]),
          size_at(k >= 1, members.empty() ? k - 1 : members[k - std::min<size_t>(k, 1)]),
          size_at(i < near_->nearest.size() && near_->nearest[i] != kNone, near_->nearest[i]),
          knows_opacity ? near_->opacity[i] : 0};
      const RansToken coded =
          symbols.wide.empty() ? hybrid_token(symbols.hybrid[k]) : wide_token(value);
      for (size_t e = 0; e < kExtras; ++e) {
        channel.bits[e] += coded.bits + channel.cost[e].add(128 * more[e] + given, coded.token);
      }
      if (i < sizes.size()) sizes[i] = size_class(value);
    }
  }

 private:
  // Which Gaussians have the symbols of a channel; empty = all.
  std::vector<size_t> members_of(const ChannelSpec& spec, size_t count) const {
    std::vector<size_t> members;
    if (count == page_->n || spec.kind != ChannelKind::kCoefficient) return members;
    const ComponentCoding& coding = header_.component(layer_, spec.component);
    const ComponentColumns& c = page_->component[spec.component];
    for (size_t i = 0; i < page_->n; ++i) {
      if (eob_coefficients(coding, c.eob_index[i]) > spec.index) members.push_back(i);
    }
    return members;
  }

  const SceneHeader& header_;
  const LayerHeader& layer_;
  const std::vector<ChannelSpec>& specs_;
  std::vector<Channel>& channels_;
  const PageColumns* page_ = nullptr;
  const Neighbours* near_ = nullptr;
};

std::string name_of(const ChannelSpec& spec) {
  switch (spec.kind) {
    case ChannelKind::kPosition:
      return "position";
    case ChannelKind::kMeanT:
    case ChannelKind::kMeanTFine:
    case ChannelKind::kWindow:
      return "mean time";
    case ChannelKind::kOpacity:
      return "opacity";
    case ChannelKind::kScaleFactor:
      return "scale factor";
    default:
      break;
  }
  const char* const components[L4D_COMPONENT_COUNT] = {"SH", "scale", "spatial rotor",
                                                       "temporal rotor"};
  const std::string component = components[spec.component];
  if (spec.kind == ChannelKind::kStepExponent) return component + ": step exponents";
  if (spec.kind == ChannelKind::kEobIndex) return component + ": EOB indices";
  if (spec.kind == ChannelKind::kCoefficient && spec.component == L4D_COMPONENT_SH &&
      spec.index < 3) {
    return component + ": first three coefficients";
  }
  return component + ": coefficients";
}

void require(const Status& status) {
  if (!status.ok()) throw std::runtime_error(status.detail());
}

void measure(const test::StreamEditor& file, size_t l,
             std::map<std::string, std::array<double, kExtras>>* sums) {
  const LayerHeader& layer = file.header.layers[l];
  if (!layer.has_entropy) return;
  EntropyTables tables;
  require(parse_entropy_tables(file.layers[l].entropy.raw, 0, file.header, layer, &tables));
  const std::vector<ChannelSpec> specs = page_channels(file.header, layer);
  std::vector<Channel> channels(specs.size());
  Meter meter(file.header, layer, specs, &channels);
  RansDecoder decoder;
  decoder.kernels = &rans_kernels_reference();
  decoder.streams = &stream_kernels_reference();
  for (const test::EditedDirectoryPage& d : file.layers[l].directory) {
    for (size_t p = 0; d.present && p < d.pages.size(); ++p) {
      if (d.pages[p].codec != static_cast<uint32_t>(ChunkCodec::kRans32)) continue;
      const PageRecord& record = d.page.pages[p];
      RansPageChunks parts;
      parts.first = d.pages[p].raw;
      parts.has_detail = record.has_sh_detail();
      if (parts.has_detail) parts.detail = d.details[p].raw;
      PageColumns page;
      Status detail;
      RansPage coded{&decoder, parts, nullptr, record.num_gaussians, &page};
      if (parts.has_detail) coded.detail = &detail;
      decode_rans_page(file.header, layer, tables, PageWants(), &coded);
      require(coded.status);
      require(detail);
      const Neighbours near(page, file.header.opacity.bits);
      meter.begin(page, near);
      visit_channels(file.header, layer, specs, page, meter);
    }
  }
  for (size_t c = 0; c < channels.size(); ++c) {
    auto& sum = (*sums)[name_of(specs[c])];
    for (size_t e = 0; e < kExtras; ++e) sum[e] += channels[c].bits[e] / 8;
  }
}

void print(const std::string& name, const std::array<double, kExtras>& sum) {
  std::printf("| %s | %.0f |", name.c_str(), sum[kNow]);
  for (size_t e = 1; e < kExtras; ++e) std::printf(" %+.1f |", 100 * (sum[e] / sum[kNow] - 1));
  std::puts("");
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 2) {
    std::fputs("usage: l4d_entropies FILE.l4d\n", stderr);
    return 2;
  }
  std::ifstream in(argv[1], std::ios::binary);
  const Bytes bytes{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  const test::StreamEditor file(bytes);
  std::map<std::string, std::array<double, kExtras>> sums;
  for (size_t l = 0; l < file.layers.size(); ++l) measure(file, l, &sums);
  std::printf("| symbols | bytes %s |", kNames[kNow]);
  for (size_t e = 1; e < kExtras; ++e) std::printf(" %s, %% |", kNames[e]);
  std::puts("\n|---|---|---|---|---|---|");
  std::array<double, kExtras> all{};
  for (const auto& [name, sum] : sums) {
    print(name, sum);
    for (size_t e = 0; e < kExtras; ++e) all[e] += sum[e];
  }
  print("all", all);
  std::array<double, kExtras> best{};  // each kind of symbols in the best of its contexts
  for (const auto& [name, sum] : sums) {
    best[kNow] += sum[kNow];
    best[1] += *std::min_element(sum.begin(), sum.end());
  }
  std::printf("\nEach row in the best of its contexts: %+.1f %%. The file has %zu bytes.\n",
              100 * (best[1] / best[kNow] - 1), bytes.size());
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "l4d_entropies: %s\n", error.what());
  return 1;
}
