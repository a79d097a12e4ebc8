// SPDX-License-Identifier: Apache-2.0
#include "encoder/component/codebook_coder.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>

#include "encoder/component/half_codebook.h"
#include "encoder/component/rcq.h"
#include "encoder/component/stage_choice.h"
#include "encoder/component/stage_refinement.h"
#include "encoder/search/kmeans.h"
#include "encoder/search/nearest.h"
#include "libl4dcodec/base/async.h"
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/threads.h"

namespace l4d {

namespace {

struct Selection {
  std::vector<uint32_t> members;  // indices in the set
  std::unique_ptr<float[]> rows;  // [members, dim]
  std::vector<float> weights;
};

void gather(const float* rows, const float* weights, size_t dim, int threads, Selection* s) {
  s->rows.reset(new float[s->members.size() * dim]);
  s->weights.resize(s->members.size());
  parallel_for(threads, s->members.size(), kGrain, [&](size_t begin, size_t end) {
    for (size_t j = begin; j < end; ++j) {
      const size_t i = s->members[j];
      std::copy_n(rows + i * dim, dim, s->rows.get() + j * dim);
      s->weights[j] = weights[i];
    }
  });
}

// The `count` members with the largest weight x squared residual; ties by index.
std::vector<uint32_t> largest_error(const std::vector<uint32_t>& members,
                                    const std::vector<float>& need, size_t count) {
  std::vector<uint32_t> chosen = members;
  const auto more = [&](uint32_t a, uint32_t b) {
    return need[a] != need[b] ? need[a] > need[b] : a < b;
  };
  if (count < chosen.size()) {
    std::nth_element(chosen.begin(), chosen.begin() + static_cast<std::ptrdiff_t>(count),
                     chosen.end(), more);
    chosen.resize(count);
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

class VqCoder {
 public:
  VqCoder(const float* rows, const float* weights, size_t n, size_t dim,
          const std::vector<BlockRange>& blocks, const ComponentSettings& settings)
      : rows_(rows), weights_(weights), blocks_(blocks), settings_(settings) {
    out_.n = n;
    out_.dim = dim;
    out_.depth.assign(n, 0);
  }

  CodedVq run() {
    choose_escapes();
    code_stage0();
    code_residual_stages();
    refine_stages(rows_, weights_, settings_, &out_);
    choose_escapes_by_cost();
    deepen_refused_rows();
    code_escapes();
    out_.weighted_distortion = sum_of_errors();
    return std::move(out_);
  }

 private:
  NearestBackend backend() const { return {settings_.threads, settings_.device}; }
  bool by_cost() const { return settings_.rd_lambda > 0; }

  double squared_error(size_t i) const {
    double sum = 0;
    for (size_t k = 0; k < out_.dim; ++k) {
      const double e = static_cast<double>(rows_[i * out_.dim + k]) -
                       static_cast<double>(out_.decoded[i * out_.dim + k]);
      sum += e * e;
    }
    return sum;
  }

  std::vector<double> weighted_errors(const std::vector<uint32_t>& members) const {
    std::vector<double> error(members.size());
    parallel_for(settings_.threads, members.size(), kGrain, [&](size_t begin, size_t end) {
      for (size_t j = begin; j < end; ++j) {
        error[j] = static_cast<double>(weights_[members[j]]) * squared_error(members[j]);
      }
    });
    return error;
  }

  // In pieces of one size, so that threads change no bit of it.
  double sum_of_errors() const {
    std::vector<double> piece((out_.n + kGrain - 1) / kGrain, 0.0);
    parallel_for(settings_.threads, piece.size(), 1, [&](size_t begin, size_t end) {
      for (size_t p = begin; p < end; ++p) {
        for (size_t i = p * kGrain; i < std::min(out_.n, (p + 1) * kGrain); ++i) {
          piece[p] += static_cast<double>(weights_[i]) * squared_error(i);
        }
      }
    });
    return std::accumulate(piece.begin(), piece.end(), 0.0);
  }

  void choose_escapes() {
    if (!(settings_.escape_threshold > 0) || by_cost()) {
      coded_.resize(out_.n);
      std::iota(coded_.begin(), coded_.end(), 0u);
      return;
    }
    for (uint32_t i = 0; i < out_.n; ++i) {
      if (static_cast<double>(weights_[i]) > settings_.escape_threshold) {
        out_.depth[i] = kEscapeDepth;
        out_.any_escape = true;
      } else {
        coded_.push_back(i);
      }
    }
  }

  // Rows that are not escapes; the input itself where all are coded.
  Selection coded_rows() const {
    Selection s;
    s.members = coded_;
    gather(rows_, weights_, out_.dim, settings_.threads, &s);
    return s;
  }

  void code_stage0() {
    const size_t dim = out_.dim;
    out_.index.emplace_back(out_.n, uint16_t{0});
    if (coded_.empty()) {  // a codebook of one entry keeps the syntax whole
      out_.decoded.assign(out_.n * dim, 0.0f);
      out_.codebooks.emplace_back(dim, 0.0f);
      return;
    }
    // New memory for SH takes as long to get as some iterations.
    const bool concurrent = resolve_threads(settings_.threads) > 1;
    std::future<void> room =
        start_async(concurrent, [&] { out_.decoded.assign(out_.n * dim, 0.0f); });
    const bool direct = coded_.size() == out_.n;
    Selection gathered;
    if (!direct) gathered = coded_rows();
    const float* rows = direct ? rows_ : gathered.rows.get();
    const float* weights = direct ? weights_ : gathered.weights.data();
    const size_t n = coded_.size();
    const uint32_t entries =
        by_cost() ? stage0_entries_by_cost() : useful_entries(settings_.codebook_size, n);
    // Nothing of the layer's codebook but its size is in those of blocks, and that is as good as
    // known: they are trained beside it.
    const bool in_blocks = settings_.rcq != 0 && !blocks_.empty();
    const std::vector<BlockRange> blocks = direct ? blocks_ : coded_blocks();
    std::vector<std::vector<float>> block_codebooks;
    std::future<void> blocks_done = start_async(concurrent, [&] {
      if (in_blocks) {
        block_codebooks = train_block_codebooks(rows, weights, dim, blocks, settings_, entries);
      }
    });
    out_.codebooks.push_back(train_half_codebook(rows, weights, n, dim, entries, settings_, 1));
    const std::vector<float>& codebook = out_.codebooks[0];
    std::vector<uint32_t> labels(n);
    std::vector<float> distance(n);
    assign_nearest(rows, n, dim, codebook.data(), codebook.size() / dim, backend(), nullptr,
                   labels.data(), distance.data());
    room.get();
    parallel_for(settings_.threads, n, kGrain, [&](size_t begin, size_t end) {
      for (size_t j = begin; j < end; ++j) {
        const size_t i = coded_[j];
        out_.depth[i] = 1;
        out_.index[0][i] = static_cast<uint16_t>(labels[j]);
        std::copy_n(codebook.data() + labels[j] * dim, dim, out_.decoded.data() + i * dim);
      }
    });
    blocks_done.get();
    if (!in_blocks) return;
    if (direct) {
      code_blocks(rows, weights, blocks, settings_, distance, block_codebooks, &out_);
      return;
    }
    // Escapes have no index: blocks are coded without them.
    CodedVq part;
    part.n = n;
    part.dim = dim;
    part.codebooks = {codebook};
    part.index.emplace_back(labels.begin(), labels.end());
    part.decoded.resize(n * dim);
    for (size_t j = 0; j < n; ++j) {
      std::copy_n(codebook.data() + labels[j] * dim, dim, part.decoded.data() + j * dim);
    }
    code_blocks(rows, weights, blocks, settings_, distance, block_codebooks, &part);
    for (size_t j = 0; j < n; ++j) {
      const size_t i = coded_[j];
      out_.index[0][i] = part.index[0][j];
      std::copy_n(part.decoded.data() + j * dim, dim, out_.decoded.data() + i * dim);
    }
    out_.residual_codebook = std::move(part.residual_codebook);
    out_.block_tables = std::move(part.block_tables);
  }

  // The blocks as ranges of coded_, which ascends.
  std::vector<BlockRange> coded_blocks() const {
    std::vector<BlockRange> blocks;
    const auto place = [&](size_t i) {
      return static_cast<size_t>(std::lower_bound(coded_.begin(), coded_.end(), i) -
                                 coded_.begin());
    };
    for (const BlockRange& b : blocks_) blocks.push_back({place(b.begin), place(b.end)});
    return blocks;
  }

  // A small codebook shows how error falls with the number of codewords, and so which number is
  // best.
  uint32_t stage0_entries_by_cost() {
    constexpr uint32_t kPilot = 64;
    constexpr size_t kMostRows = 65536;  // that the spread of all is estimated from
    const size_t n = out_.n, dim = out_.dim;
    const size_t step = std::max<size_t>(1, n / kMostRows);
    std::vector<double> mean(dim, 0.0);
    double total = 0, before = 0;
    for (size_t i = 0; i < n; i += step) {
      total += static_cast<double>(weights_[i]);
      for (size_t k = 0; k < dim; ++k) {
        mean[k] += static_cast<double>(weights_[i]) * static_cast<double>(rows_[i * dim + k]);
      }
    }
    if (!(total > 0)) return 1;
    for (size_t i = 0; i < n; i += step) {
      double e2 = 0;
      for (size_t k = 0; k < dim; ++k) {
        const double e = static_cast<double>(rows_[i * dim + k]) - mean[k] / total;
        e2 += e * e;
      }
      before += static_cast<double>(weights_[i]) * e2 * static_cast<double>(step);
    }
    KMeansOptions options;
    options.num_codewords = useful_entries(kPilot, n);
    options.iterations = 3;
    options.seed = settings_.seed;
    options.threads = settings_.threads;
    options.device = settings_.device;
    const Codebook pilot = train_codebook(rows_, weights_, n, dim, options);
    const double after = pilot.weighted_distortion;
    effective_dim_ = effective_dimension(before, after, static_cast<double>(pilot.size()));
    return codewords_by_cost(before, n, dim, effective_dim_, settings_.rd_lambda,
                             useful_entries(settings_.codebook_size, n));
  }

  // Which members get stage s, and from how many codewords. error: by row, weighted.
  StageChoice choose_members(size_t s, const std::vector<uint32_t>& members,
                             const std::vector<float>& error) const {
    if (by_cost()) {
      return choose_stage(members, error, out_.dim, effective_dim_, settings_.rd_lambda,
                          useful_entries(settings_.codebook_size, members.size()));
    }
    StageChoice out;
    out.members =
        largest_error(members, error,
                      static_cast<size_t>(std::llround(static_cast<double>(settings_.stages[s]) *
                                                       static_cast<double>(out_.n))));
    out.codewords = useful_entries(settings_.codebook_size, out.members.size());
    return out;
  }

  void code_residual_stages() {
    const size_t dim = out_.dim;
    const size_t most = by_cost() ? L4D_MAX_STAGES : settings_.stages.size();
    if (most < 2) return;
    std::vector<uint32_t> members = coded_;
    std::vector<float> need(out_.n);
    const std::unique_ptr<float[]> residual(new float[out_.n * dim]);  // of members
    for (size_t s = 1; s < most; ++s) {
      parallel_for(settings_.threads, members.size(), kGrain, [&](size_t begin, size_t end) {
        for (size_t j = begin; j < end; ++j) {
          const size_t i = members[j];
          need[i] = static_cast<float>(static_cast<double>(weights_[i]) * squared_error(i));
          for (size_t k = 0; k < dim; ++k) {
            residual[i * dim + k] = rows_[i * dim + k] - out_.decoded[i * dim + k];
          }
        }
      });
      const StageChoice choice = choose_members(s, members, need);
      Selection chosen;
      chosen.members = choice.members;
      if (chosen.members.empty()) break;
      gather(residual.get(), weights_, dim, settings_.threads, &chosen);
      const size_t n = chosen.members.size();
      out_.codebooks.push_back(train_half_codebook(chosen.rows.get(), chosen.weights.data(), n, dim,
                                                   choice.codewords, settings_, 1 + s));
      const std::vector<float>& codebook = out_.codebooks[s];
      std::vector<uint32_t> labels(n);
      std::vector<float> distance(n);
      assign_nearest(chosen.rows.get(), n, dim, codebook.data(), codebook.size() / dim, backend(),
                     nullptr, labels.data(), distance.data());
      out_.index.emplace_back(out_.n, uint16_t{0});
      parallel_for(settings_.threads, n, kGrain, [&](size_t begin, size_t end) {
        for (size_t j = begin; j < end; ++j) {
          const size_t i = chosen.members[j];
          out_.depth[i] = static_cast<uint8_t>(s + 1);
          out_.index[s][i] = static_cast<uint16_t>(labels[j]);
          for (size_t k = 0; k < dim; ++k) {
            out_.decoded[i * dim + k] = out_.decoded[i * dim + k] + codebook[labels[j] * dim + k];
          }
        }
      });
      if (by_cost()) learn_dimension(chosen.members, need, codebook.size() / dim);
      members = chosen.members;
    }
  }

  // What a stage did to its members' error says what the next one will do.
  void learn_dimension(const std::vector<uint32_t>& members, const std::vector<float>& error,
                       size_t codewords) {
    const std::vector<double> left = weighted_errors(members);
    double before = 0, after = 0;
    for (size_t j = 0; j < members.size(); ++j) {
      before += static_cast<double>(error[members[j]]);
      after += left[j];
    }
    effective_dim_ = effective_dimension(before, after, static_cast<double>(codewords));
  }

  // Rows whose last error is worth more than all of their numbers in binary16.
  void choose_escapes_by_cost() {
    if (!by_cost() || !out_.block_tables.empty()) return;
    constexpr double kBitsPerNumber = 13;
    const double worth = settings_.rd_lambda * kBitsPerNumber * static_cast<double>(out_.dim);
    const std::vector<double> error = weighted_errors(coded_);
    for (size_t j = 0; j < coded_.size(); ++j) {
      if (error[j] <= worth) continue;
      out_.depth[coded_[j]] = kEscapeDepth;
      out_.any_escape = true;
    }
  }

  // Rows that the check refuses, with as many more stages as it takes; escapes where all of them do
  // not do.
  void deepen_refused_rows() {
    if (!settings_.keeps || !out_.block_tables.empty()) return;
    parallel_for(settings_.threads, coded_.size(), kGrain, [&](size_t begin, size_t end) {
      for (size_t j = begin; j < end; ++j) {
        const size_t i = coded_[j];
        const float* decoded = out_.decoded.data() + i * out_.dim;
        while (out_.depth[i] != kEscapeDepth && !settings_.keeps(i, decoded)) {
          if (out_.depth[i] == out_.codebooks.size()) {
            out_.depth[i] = kEscapeDepth;
          } else {
            add_stage(i);
          }
        }
      }
    });
    out_.any_escape =
        std::find(out_.depth.begin(), out_.depth.end(), kEscapeDepth) != out_.depth.end();
  }

  // The nearest codeword of the next stage.
  void add_stage(size_t i) {
    const size_t dim = out_.dim, s = out_.depth[i];
    const std::vector<float>& codebook = out_.codebooks[s];
    float* decoded = out_.decoded.data() + i * dim;
    size_t best = 0;
    double least = std::numeric_limits<double>::infinity();
    for (size_t w = 0; w < codebook.size() / dim; ++w) {
      double sum = 0;
      for (size_t k = 0; k < dim && sum < least; ++k) {
        const double e = static_cast<double>(rows_[i * dim + k]) -
                         static_cast<double>(decoded[k] + codebook[w * dim + k]);
        sum += e * e;
      }
      if (sum < least) {
        least = sum;
        best = w;
      }
    }
    for (size_t k = 0; k < dim; ++k) decoded[k] = decoded[k] + codebook[best * dim + k];
    out_.index[s][i] = static_cast<uint16_t>(best);
    out_.depth[i] = static_cast<uint8_t>(s + 1);
  }

  void code_escapes() {
    for (size_t i = 0; i < out_.n; ++i) {
      if (out_.depth[i] != kEscapeDepth) continue;
      for (size_t k = 0; k < out_.dim; ++k) {
        out_.decoded[i * out_.dim + k] =
            half_to_float(float_to_half_saturate(rows_[i * out_.dim + k]));
      }
    }
  }

  const float* rows_;
  const float* weights_;
  const std::vector<BlockRange>& blocks_;
  const ComponentSettings& settings_;
  std::vector<uint32_t> coded_;
  double effective_dim_ = 1;  // of what is left, where bits have a price
  CodedVq out_;
};

}  // namespace

ComponentSettings component_settings(const EncoderSettings& settings, unsigned component) {
  const int c = static_cast<int>(component);
  ComponentSettings s;
  s.codebook_size = static_cast<uint32_t>(settings.get(Parameter::kCodebookSize, c));
  s.stages = settings.stages(c);
  s.escape_threshold = settings.get(Parameter::kEscapeThreshold, c);
  s.refine_rounds = settings.get_int(Parameter::kRefine);
  s.rcq = settings.get_int(Parameter::kRcq);
  s.rcq_size = static_cast<uint32_t>(settings.get(Parameter::kRcqSize));
  s.iterations = settings.get_int(Parameter::kKmeansIterations);
  s.sample_per_codeword = static_cast<size_t>(settings.get(Parameter::kKmeansSample));
  return s;
}

CodedVq code_vq(const float* rows, const float* weights, size_t n, size_t dim,
                const std::vector<BlockRange>& blocks, const ComponentSettings& settings) {
  return VqCoder(rows, weights, n, dim, blocks, settings).run();
}

}  // namespace l4d
