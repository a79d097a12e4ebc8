// SPDX-License-Identifier: Apache-2.0
#include "encoder/file/page_builder.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <numeric>

#include "encoder/file/entropy_model.h"
#include "encoder/layer/coder_options.h"
#include "encoder/layer/position_coding.h"
#include "encoder/prepare/scalar.h"
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/base/ordered.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/scene/layers.h"
#include "libl4dcodec/scene/morton.h"

namespace l4d {
namespace {

// binary16 not above (or not below) a value.
uint16_t half_outward(double value, bool up) {
  const float rounded = static_cast<float>(value);
  uint16_t h = float_to_half_saturate(rounded);
  const double back = static_cast<double>(half_to_float(h));
  const uint16_t ordered = order_half(h);
  if (up && back < value && ordered < order_half(kHalfMax)) {
    h = unorder_half(static_cast<uint16_t>(ordered + 1));
  } else if (!up && back > value && ordered > order_half(kHalfMax | 0x8000u)) {
    h = unorder_half(static_cast<uint16_t>(ordered - 1));
  }
  return h;
}

// Compressing a page as a whole adds a pass over all of it: one part in sixteen must be saved.
constexpr size_t kMinPageSaving = 16;
// An SH chunk, without which SH is base colour, costs a set of rANS states and a place and a hash
// in the directory, about 150 bytes. Readers take gaps of this size with what lies around them
// anyway.
constexpr size_t kMinDetailBytes = 4096;

// Counts the symbols of a page on their way to the counts of their tokens.
class SymbolCounter : public ChannelVisitor {
 public:
  explicit SymbolCounter(ChannelVisitor& to) : to_(to) {}
  void visit(const ChannelSymbols& symbols) override {
    count_ += symbols.hybrid.size() + symbols.wide.size();
    to_.visit(symbols);
  }
  uint64_t count() const { return count_; }

 private:
  ChannelVisitor& to_;
  uint64_t count_ = 0;
};

class LayerBuilder {
 public:
  LayerBuilder(const EncoderScene& scene, const SceneHeader& header,
               const LayerHeader& layer_header, const CodedLayer& layer, const PageOptions& options)
      : scene_(scene),
        header_(header),
        layer_header_(layer_header),
        layer_(layer),
        options_(options) {}

  BuiltLayer run(int threads) {
    code_positions();
    cut(options_.size);
    BuiltLayer out;
    out.pages.resize(cuts_.size());
    std::unique_ptr<EntropyModel> model;
    if (options_.rans && rans_codable(header_, layer_header_)) {
      model = make_model(threads, &out.symbols_per_gaussian);
      out.entropy = model->serialize();
    }
    parallel_for(threads, cuts_.size(), grain(), [&](size_t begin, size_t end) {
      StreamEncoder streams(options_.zstd_level);
      ZstdCompressor whole(options_.zstd_level);
      for (size_t p = begin; p < end; ++p) {
        if (options_.cancelled != nullptr && (*options_.cancelled)()) throw Cancelled();
        out.pages[p] = build_page(cuts_[p], model.get(), streams, whole);
      }
    });
    for (const uint32_t j : order_) out.order.push_back(layer_.gaussians[j]);
    return out;
  }

 private:
  // In pages: what a thread makes for itself may take longer than a page of few Gaussians.
  size_t grain() const { return 1 + cuts_.size() / 64; }

  bool lossless() const { return header_.position == CoordinateCodingId::kRaw32; }
  bool raw() const { return header_.position_of(layer_header_) == CoordinateCodingId::kRaw32; }
  bool fixed() const { return header_.position_of(layer_header_) == CoordinateCodingId::kFixed; }
  // The input's own bits, where the scene is lossless.
  float raw_position(size_t j, size_t k) const {
    return lossless() ? scene_.raw_position[3 * layer_.gaussians[j] + k]
                      : static_cast<float>(layer_.position[3 * j + k]);
  }

  // Pages are made twice, once to count and once to code: their columns may be larger than the
  // scene.
  std::unique_ptr<EntropyModel> make_model(int threads, unsigned* symbols_per_gaussian) const {
    const std::vector<ChannelSpec> channels = page_channels(header_, layer_header_);
    TokenCounts counts(channels);
    std::mutex mutex;
    parallel_for(threads, cuts_.size(), grain(), [&](size_t begin, size_t end) {
      TokenCounts own(channels);
      uint64_t most = 0;
      for (size_t p = begin; p < end; ++p) {
        if (options_.cancelled != nullptr && (*options_.cancelled)()) throw Cancelled();
        const PageColumns columns = make_columns(cuts_[p]);
        SymbolCounter page(own);
        visit_channels(header_, layer_header_, channels, columns, page);
        most = std::max<uint64_t>(most, (page.count() + columns.n - 1) / columns.n);
      }
      std::lock_guard<std::mutex> lock(mutex);
      counts.add(own);
      *symbols_per_gaussian = std::max(*symbols_per_gaussian, static_cast<unsigned>(most));
    });
    return std::make_unique<EntropyModel>(channels, counts);
  }

  // Coded positions, and the order inside buckets along a Morton curve over their ordered integers.
  void code_positions() {
    const size_t n = layer_.gaussians.size();
    half_.resize(fixed() ? 0 : 3 * n);
    fixed_.resize(fixed() ? 3 * n : 0);
    std::vector<uint64_t> key(n);
    for (size_t j = 0; j < n; ++j) {
      uint32_t code[3];
      for (size_t k = 0; k < 3; ++k) {
        const double scaled =
            (layer_.position[3 * j + k] - static_cast<double>(header_.position_center[k])) /
            static_cast<double>(header_.position_scale);
        if (fixed()) {
          const double last = static_cast<double>((1u << header_.position_bits) - 1);
          code[k] = nearest_code<uint32_t>(scaled, 0, last);
          fixed_[3 * j + k] = code[k];
        } else if (raw()) {
          code[k] = static_cast<uint16_t>(order_float(raw_position(j, k)) >> 16);
        } else {
          half_[3 * j + k] = float_to_half_saturate(static_cast<float>(scaled));
          code[k] = order_half(half_[3 * j + k]);
        }
      }
      key[j] = morton_code(code[0], code[1], code[2]);
    }
    order_.resize(n);
    std::iota(order_.begin(), order_.end(), 0u);
    std::sort(order_.begin(), order_.end(), [&](uint32_t a, uint32_t b) {
      if (layer_.bucket[a] != layer_.bucket[b]) return layer_.bucket[a] < layer_.bucket[b];
      return key[a] != key[b] ? key[a] < key[b] : a < b;
    });
  }

  struct Cut {
    size_t begin, end;
  };
  void cut(size_t page_size) {
    for (size_t begin = 0; begin < order_.size();) {
      const uint32_t bucket = layer_.bucket[order_[begin]];
      size_t end = begin;
      while (end < order_.size() && layer_.bucket[order_[end]] == bucket) ++end;
      // Equal pages: a short last one would compress badly.
      const size_t pages = (end - begin + page_size - 1) / page_size;
      const size_t count = end - begin;
      for (size_t p = 0; p < pages; ++p) {
        cuts_.push_back({begin + count * p / pages, begin + count * (p + 1) / pages});
      }
      begin = end;
    }
  }

  // Gaussians are ordered by bucket and blocks are runs of Gaussians; the order changes only inside
  // buckets, so a Gaussian's place in the list still tells its block.
  uint32_t block_of(size_t index) const {
    for (size_t b = 0; b < layer_.blocks.size(); ++b) {
      if (index < layer_.blocks[b].begin || index >= layer_.blocks[b].end) continue;
      const BlockRecord entries = block_entries(layer_, b);
      for (const RcqTableRef& t : entries.tables) {
        if (t.num_entries != 0) return static_cast<uint32_t>(b);
      }
    }
    return kNoBlock;
  }

  PageColumns make_columns(const Cut& cut) const {
    PageColumns columns;
    const size_t n = cut.end - cut.begin;
    columns.n = n;
    for (size_t k = 0; k < 3; ++k) {
      for (size_t i = 0; i < n; ++i) {
        const size_t j = order_[cut.begin + i];
        if (raw()) {
          columns.raw_position[k].push_back(raw_position(j, k));
        } else if (fixed()) {
          columns.fixed_position[k].push_back(fixed_[3 * j + k]);
        } else {
          columns.position[k].push_back(half_[3 * j + k]);
        }
      }
    }
    for (size_t i = 0; i < n; ++i) {
      const size_t j = order_[cut.begin + i];
      if (layer_header_.has_mean_codes()) columns.mean_t.push_back(layer_.mean_t[j]);
      if (layer_header_.mean_t_fine) columns.mean_t_fine.push_back(layer_.mean_t_fine[j]);
      if (layer_header_.flat()) add_window(j, &columns);
      if (layer_header_.mean_t == CoordinateCodingId::kRaw64) {
        columns.raw64_mean_t.push_back(scene_.mean_t[layer_.gaussians[j]]);
      }
      if (layer_header_.mean_t == CoordinateCodingId::kRaw32) {
        columns.raw_mean_t.push_back(lossless() ? scene_.raw_mean_t[layer_.gaussians[j]]
                                                : static_cast<float>(layer_.decoded_mean_t[j]));
      }
      if (lossless()) {
        columns.raw_opacity.push_back(layer_.opacity[j]);
      } else {
        columns.opacity.push_back(scalar_code(header_.opacity, layer_.opacity[j]));
        if (!layer_.factor.empty()) columns.scale_factor.push_back(layer_.factor[j]);
      }
    }
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) add_component(c, cut, &columns);
    return columns;
  }

  void add_window(size_t j, PageColumns* columns) const {
    const FrameWindow window = scene_.window[layer_.gaussians[j]];
    const uint32_t base =
        window_base(layer_.bucket[j], layer_header_.level, scene_.timeline.num_frames);
    const uint32_t values[2] = {window.begin - base,
                                window.end - window.begin - layer_header_.window_length};
    for (size_t k = 0; k < kWindowColumns; ++k) {
      columns->window[k].push_back(static_cast<uint16_t>(values[k / 2] >> (16 * (k % 2))));
    }
  }

  BuiltPage build_page(const Cut& cut, const EntropyModel* model, StreamEncoder& streams,
                       ZstdCompressor& whole) const {
    BuiltPage page;
    const PageColumns columns = make_columns(cut);
    page.record.block = block_of(order_[cut.begin]);
    if (model != nullptr) {
      Bytes bytes =
          model->encode_page(header_, layer_header_, columns, &page.sh_detail, kMinDetailBytes);
      page.record.sh_detail.stored_bytes = static_cast<uint32_t>(page.sh_detail.size());
      if (!page.sh_detail.empty()) page.record.sh_detail.hash = hash64(page.sh_detail);
      page.record.chunk.raw_bytes = static_cast<uint32_t>(bytes.size());
      page.record.chunk.codec = static_cast<uint32_t>(ChunkCodec::kRans32);
      finish(cut, std::move(bytes), &page);
      return page;
    }
    BlockRecord entries;
    if (page.record.block != kNoBlock) entries = block_entries(layer_, page.record.block);
    Bytes raw = encode_page(streams, header_, layer_header_,
                            page.record.block == kNoBlock ? nullptr : &entries, columns);
    page.record.chunk.raw_bytes = static_cast<uint32_t>(raw.size());
    page.record.chunk.codec = static_cast<uint32_t>(ChunkCodec::kStored);
    // Streams of a large page were compressed one by one; a small page may do better as a whole.
    if (raw.size() < 65536) {
      Bytes frame = whole.compress(raw);
      if (frame.size() + raw.size() / kMinPageSaving < raw.size()) {
        raw = std::move(frame);
        page.record.chunk.codec = static_cast<uint32_t>(ChunkCodec::kZstd);
      }
    }
    finish(cut, std::move(raw), &page);
    return page;
  }

  void add_component(unsigned c, const Cut& cut, PageColumns* columns) const {
    const ComponentCoding& coding = header_.component(layer_header_, c);
    const unsigned dim = header_.component_dim(layer_header_, c);
    ComponentColumns& to = columns->component[c];
    if (coding.coding == ComponentCodingId::kRaw32) {
      for (size_t i = cut.begin; i < cut.end; ++i) {
        // The bits given, and not those of another rotor of the same rotation: rounded to binary32,
        // that would move at another velocity.
        const l4d_gaussians& given = scene_.given;
        const size_t s = scene_.source[layer_.gaussians[order_[i]]];
        const float* from = c == L4D_COMPONENT_SH              ? given.sh + dim * s
                            : c == L4D_COMPONENT_SCALE         ? given.log_scale + 4 * s
                            : c == L4D_COMPONENT_ROTOR_SPATIAL ? given.rotor + 8 * s
                                                               : given.rotor + 8 * s + 4;
        to.raw.insert(to.raw.end(), from, from + dim);
      }
      return;
    }
    if (coding.transform()) {
      return add_transform(coding, std::get<CodedTransform>(layer_.component[c]), cut, &to);
    }
    if (!coding.vq()) return;
    const CodedVq& from = std::get<CodedVq>(layer_.component[c]);
    for (size_t i = cut.begin; i < cut.end; ++i) {
      const size_t j = order_[i];
      const uint8_t depth = from.depth[j];
      to.depth.push_back(depth);
      if (depth == kEscapeDepth) {
        for (size_t k = 0; k < dim; ++k) {
          to.escape.push_back(float_to_half(from.decoded[dim * j + k]));
        }
        ++to.num_escapes;
        continue;
      }
      for (size_t s = 0; s < depth; ++s) {
        to.index[s].push_back(from.index[s][j]);
        ++to.index_count[s];
      }
    }
  }

  void add_transform(const ComponentCoding& coding, const CodedTransform& from, const Cut& cut,
                     ComponentColumns* to) const {
    for (size_t i = cut.begin; i < cut.end; ++i) {
      const size_t j = order_[i];
      to->step_exponent.push_back(from.step_exponent[j]);
      to->eob_index.push_back(from.eob_index[j]);
      for (unsigned k = 0; k < eob_coefficients(coding, from.eob_index[j]); ++k) {
        to->coefficient[k].push_back(from.coefficient[k][j]);
        ++to->coefficient_count[k];
      }
    }
  }

  void finish(const Cut& cut, Bytes raw, BuiltPage* page) const {
    page->record.chunk.stored_bytes = static_cast<uint32_t>(raw.size());
    page->record.chunk.hash = hash64(raw);
    page->record.num_gaussians = static_cast<uint32_t>(cut.end - cut.begin);
    page->record.bucket = layer_.bucket[order_[cut.begin]];
    page->bytes = std::move(raw);
    bound(cut, &page->record);
  }

  // Visible interval and the box of all centres over it, both rounded outward.
  void bound(const Cut& cut, PageRecord* record) const {
    const double begin = scene_.timeline.time_begin;
    const double end = begin + scene_.duration;
    const double center = bucket_center(scene_.timeline, layer_header_.level, record->bucket);
    const double unit = bucket_width(scene_.timeline, layer_header_.level) / 64;
    double first = end, last = begin;
    double low[3], high[3];
    std::fill_n(low, 3, HUGE_VAL);
    std::fill_n(high, 3, -HUGE_VAL);
    for (size_t i = cut.begin; i < cut.end; ++i) {
      const size_t j = order_[i];
      const double mean = layer_.decoded_mean_t[j];
      const double reach = 4 * kExtentGuard / std::sqrt(layer_.decoded_lambda[j]);
      Sequence shown = {begin, end};
      if (layer_.fades()) shown = {mean - reach, mean + reach};
      if (layer_.flat) shown = window_times(scene_.timeline, scene_.window[layer_.gaussians[j]]);
      const double a = std::clamp(shown.begin, begin, end);
      const double b = std::clamp(shown.end, begin, end);
      first = std::min(first, a);
      last = std::max(last, b);
      const double reference =
          header_.position_at_mean_time ? mean : reference_time(scene_.timeline, mean);
      for (size_t k = 0; k < 3; ++k) {
        const double p = coded_position(header_, layer_, j, k);
        const double v = layer_.decoded_velocity[3 * j + k];
        for (const double t : {a, b}) {
          const double x = p + v * (t - reference);
          low[k] = std::min(low[k], x);
          high[k] = std::max(high[k], x);
        }
      }
    }
    record->visible_begin =
        static_cast<uint8_t>(std::clamp(std::floor((first - center) / unit) + 128, 0.0, 255.0));
    record->visible_end =
        static_cast<uint8_t>(std::clamp(std::ceil((last - center) / unit) + 128, 0.0, 255.0));
    for (size_t k = 0; k < 3; ++k) {
      const auto scaled = [&](double x, double sign) {
        const double s =
            (x - static_cast<double>(header_.position_center[k])) / header_.bounds_unit();
        return s + sign * std::fabs(s) * 0x1p-20;
      };
      record->bounds[k] = half_outward(scaled(low[k], -1), false);
      record->bounds[3 + k] = half_outward(scaled(high[k], 1), true);
    }
  }

  const EncoderScene& scene_;
  const SceneHeader& header_;
  const LayerHeader& layer_header_;
  const CodedLayer& layer_;
  PageOptions options_;
  std::vector<uint16_t> half_;   // [m, 3], or
  std::vector<uint32_t> fixed_;  // [m, 3]
  std::vector<uint32_t> order_;  // stored order: indices of Gaussians
  std::vector<Cut> cuts_;
};

}  // namespace

BlockRecord block_entries(const CodedLayer& layer, size_t block) {
  BlockRecord record;
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const auto* vq = std::get_if<CodedVq>(&layer.component[c]);
    if (vq == nullptr || block >= vq->block_tables.size()) continue;
    record.tables[c].num_entries = static_cast<uint32_t>(vq->block_tables[block].size());
  }
  return record;
}

BuiltLayer build_layer(const EncoderScene& scene, const SceneHeader& header,
                       const LayerHeader& layer_header, const CodedLayer& layer,
                       const PageOptions& options, int threads) {
  return LayerBuilder(scene, header, layer_header, layer, options).run(threads);
}

}  // namespace l4d
