// SPDX-License-Identifier: Apache-2.0
// Checks of a whole stream, including those that a decoder need not make.
#include <algorithm>
#include <cmath>

#include "decoder/conformance.h"
#include "decoder/decoder.h"
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/math/layers.h"
#include "libl4dcodec/math/slice.h"

namespace l4d {
namespace {

class Validator {
 public:
  Validator(SceneFile& file, PageDecoder& pages, const l4d_decoder_options& options,
            const ViolationFn& report)
      : file_(file), pages_(pages), options_(options), report_(report) {}

  Status run() {
    const SceneHeader& header = file_.header();
    take({0, 0, FileHeader::kBytes, 0, 0}, "the file header");
    take({file_.file_header().header_offset, 0, file_.file_header().header_bytes, 0, 0},
         "the scene header");
    L4D_RETURN_IF_ERROR(check_codebooks(header.sh, 0, L4D_COMPONENT_SH));
    for (uint32_t l = 0; l < header.layers.size(); ++l) {
      for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
        L4D_RETURN_IF_ERROR(check_codebooks(header.layers[l].component[c], l, c));
      }
      L4D_RETURN_IF_ERROR(advance(0));
      L4D_RETURN_IF_ERROR(check_layer(l));
    }
    check_overlaps();
    return check_declared();
  }

 private:
  struct Taken {
    uint64_t begin, end;
    const char* what;
  };

  // Gaussians are what is counted: their number is known, that of the pages is not.
  Status advance(uint64_t gaussians) {
    done_ += gaussians;
    if (options_.progress == nullptr) return {};
    const uint64_t total = file_.header().num_gaussians;
    if (options_.progress(options_.progress_user, std::min(done_, total), total, "validate") == 0) {
      return {};
    }
    return Status(L4D_ERR_CANCELLED, "cancelled by the progress callback");
  }

  static bool is_of_host(const Status& status) {
    return status.code() == L4D_ERR_IO || status.code() == L4D_ERR_OUT_OF_MEMORY ||
           status.code() == L4D_ERR_LIMIT_EXCEEDED || status.code() == L4D_ERR_CANCELLED;
  }

  // Errors of the stream are reported and passed over; those of the host end the check.
  Status note(Status status) {
    if (status.ok() || is_of_host(status)) return status;
    report_(status);
    return {};
  }

  void take(const ChunkRef& chunk, const char* what) {
    if (chunk.stored_bytes == 0) return;
    taken_.push_back({chunk.offset, chunk.offset + chunk.stored_bytes, what});
  }

  Status check_codebooks(const ComponentCoding& coding, uint32_t layer, unsigned c) {
    const CodebookData* book = nullptr;
    for (unsigned s = 0; s < coding.num_books(); ++s) {
      take(coding.book(s).codebook, "a codebook");
      L4D_RETURN_IF_ERROR(note(file_.codebook(layer, c, s, &book)));
    }
    if (!coding.has_rcq) return {};
    take(coding.rcq.codebook, "a residual codebook");
    return note(file_.codebook(layer, c, SceneFile::kRcqStage, &book));
  }

  Status check_layer(uint32_t l) {
    const LayerHeader& layer = file_.header().layers[l];
    if (layer.num_gaussians == 0) return {};
    if (layer.has_entropy) {
      const EntropyTables* tables = nullptr;
      take(layer.entropy, "entropy tables");
      L4D_RETURN_IF_ERROR(note(file_.entropy_tables(l, &tables)));
    }
    take({layer.page_table_offset, 0,
          num_directory_pages(layer) * static_cast<uint32_t>(PageTableEntry::kBytes), 0, 0},
         "a page table");
    uint64_t total = 0;
    for (uint32_t d = 0; d < num_directory_pages(layer); ++d) {
      std::vector<const DirectoryPage*> pages;
      const Status status = file_.directory_pages(l, d, d, &pages);
      if (!status.ok()) {
        L4D_RETURN_IF_ERROR(note(status));
        continue;
      }
      L4D_RETURN_IF_ERROR(take_directory_page(layer, d));
      if (pages[0] == nullptr) continue;
      const DirectoryPage page = *pages[0];  // the cache may drop it meanwhile
      for (const BlockRecord& block : page.blocks) {
        for (const RcqTableRef& t : block.tables) take(t.chunk, "a block codebook");
      }
      for (const PageRecord& record : page.pages) {
        take(record.chunk, "a page");
        take(record.sh_detail, "the SH detail of a page");
        total += record.num_gaussians;
        L4D_RETURN_IF_ERROR(note(check_page(l, d, record)));
        L4D_RETURN_IF_ERROR(advance(record.num_gaussians));
      }
      file_.trim();
    }
    if (total != layer.num_gaussians) {
      report_(corrupt("DIR-5", layer.page_table_offset,
                      "layer " + std::to_string(l) + " holds " + std::to_string(total) +
                          " Gaussians, its header says " + std::to_string(layer.num_gaussians)));
    }
    return {};
  }

  Status take_directory_page(const LayerHeader& layer, uint32_t d) {
    Bytes storage;
    ByteSpan bytes;
    const uint64_t at = layer.page_table_offset + uint64_t{d} * PageTableEntry::kBytes;
    L4D_RETURN_IF_ERROR(file_.source().read(at, PageTableEntry::kBytes, storage, &bytes));
    PageTableEntry entry;
    L4D_RETURN_IF_ERROR(note(PageTableEntry::parse(bytes, at, &entry)));
    take(entry.chunk, "a directory page");
    return {};
  }

  // Decodes one page and holds its Gaussians against the bucket it lies in.
  Status check_page(uint32_t l, uint32_t d, const PageRecord& record) {
    const SceneHeader& header = file_.header();
    const LayerHeader& layer = header.layers[l];
    const size_t n = record.num_gaussians;
    Plan plan;
    l4d_range range{};
    range.count = n;
    range.center = bucket_center(header.timeline, layer.level, record.bucket);
    range.width = bucket_width(header.timeline, layer.level);
    range.layer = l;
    range.bucket = record.bucket;
    plan.ranges.push_back(range);
    PageTask task;
    task.record = record;
    task.layer = l;
    task.directory_index = d;
    plan.tasks.push_back(task);
    position_.resize(3 * n);
    mean_.resize(n);
    log_scale_.resize(4 * n);
    rotor_.resize(8 * n);
    opacity_.resize(n);
    sh_.resize(header.sh_dim() * n);
    l4d_gaussian_buffers out{};
    out.position = position_.data();
    out.mean_t_double = mean_.data();
    out.log_scale = log_scale_.data();
    out.rotor = rotor_.data();
    out.opacity = opacity_.data();
    out.sh = sh_.data();
    L4D_RETURN_IF_ERROR(pages_.expand(plan, 0, 1, out, nullptr, nullptr));
    return layer.permanent ? check_bounds(header, layer, record, range)
                           : check_times(header, layer, record, range);
  }

  // lambda and velocity of Gaussian i of the page at hand, in double.
  Slice4D<double> slice_of(size_t i) const {
    double r[8], s[4];
    for (size_t k = 0; k < 8; ++k) r[k] = static_cast<double>(rotor_[8 * i + k]);
    for (size_t k = 0; k < 4; ++k) s[k] = std::exp(static_cast<double>(log_scale_[4 * i + k]));
    return slice_gaussian(normalized_halves(r), s);
  }

  Status check_times(const SceneHeader& header, const LayerHeader& layer, const PageRecord& record,
                     const l4d_range& range) {
    const double unit = range.width / 64;
    const double begin = header.timeline.time_begin;
    const double end = begin + sequence_duration(header.timeline);
    for (size_t i = 0; i < record.num_gaussians; ++i) {
      const double mean = mean_[i];
      const double sigma = 1 / std::sqrt(slice_of(i).lambda);
      if (!fits_layer(mean, sigma, record.bucket, layer.level, header.timeline)) {
        return corrupt("LAYR-1", record.chunk.offset,
                       "Gaussian " + std::to_string(i) + " of a page of bucket " +
                           std::to_string(record.bucket) + ", level " +
                           std::to_string(layer.level) +
                           " is visible beyond the neighbouring buckets");
      }
      const double first = std::max(begin, mean - 4 * sigma);
      const double last = std::min(end, mean + 4 * sigma);
      if (first > last) continue;
      const double slack = 1e-9 * range.width;
      if ((record.visible_begin > 0 &&
           first < range.center + (record.visible_begin - 128) * unit - slack) ||
          (record.visible_end < 255 &&
           last > range.center + (record.visible_end - 128) * unit + slack)) {
        return corrupt(
            "DIR-9", record.chunk.offset,
            "Gaussian " + std::to_string(i) + " is visible outside the interval of its page");
      }
    }
    return check_bounds(header, layer, record, range);
  }

  Status check_bounds(const SceneHeader& header, const LayerHeader& layer, const PageRecord& record,
                      const l4d_range& range) {
    const double begin = header.timeline.time_begin;
    const double end = begin + sequence_duration(header.timeline);
    for (size_t i = 0; i < record.num_gaussians; ++i) {
      const Slice4D<double> s = slice_of(i);
      const double mean = mean_[i];
      const double reach = 4 / std::sqrt(s.lambda);
      const double reference =
          header.position_at_mean_time ? mean : reference_time(header.timeline, mean);
      const double first = layer.permanent ? begin : std::max(begin, mean - reach);
      const double last = layer.permanent ? end : std::min(end, mean + reach);
      if (first > last) continue;
      for (size_t k = 0; k < 3; ++k) {
        for (const double t : {first, last}) {
          const double x =
              static_cast<double>(position_[3 * i + k]) + s.velocity[k] * (t - reference);
          const double coded =
              (x - static_cast<double>(header.position_center[k])) / header.bounds_unit();
          const double slack = std::fabs(coded) * 1e-6;
          const double low = static_cast<double>(half_to_float(record.bounds[k]));
          const double high = static_cast<double>(half_to_float(record.bounds[3 + k]));
          // The outermost halves stand for everything beyond.
          if ((coded < low - slack && low > -65504) || (coded > high + slack && high < 65504)) {
            return corrupt("DIR-10", record.chunk.offset,
                           "Gaussian " + std::to_string(i) + " leaves the box of its page");
          }
        }
      }
    }
    return {};
  }

  void check_overlaps() {
    std::sort(taken_.begin(), taken_.end(),
              [](const Taken& a, const Taken& b) { return a.begin < b.begin; });
    for (size_t i = 1; i < taken_.size(); ++i) {
      if (taken_[i].begin < taken_[i - 1].end) {
        report_(corrupt("CHNK-4", taken_[i].begin,
                        std::string(taken_[i].what) + " overlaps " + taken_[i - 1].what));
      }
    }
  }

  // Last, for a directory that cannot be read is reported by then.
  Status check_declared() {
    const SceneHeader& header = file_.header();
    const Status status =
        check_conformance(file_, header.profile, header.conformance_level, report_);
    return is_of_host(status) ? status : Status();
  }

  SceneFile& file_;
  PageDecoder& pages_;
  const l4d_decoder_options& options_;
  const ViolationFn& report_;
  uint64_t done_ = 0;
  std::vector<Taken> taken_;
  std::vector<double> mean_;
  std::vector<float> position_, log_scale_, rotor_, opacity_, sh_;
};

}  // namespace

Status validate_stream(ByteSource source, const l4d_decoder_options& options,
                       const ViolationFn& report) {
  Decoder decoder(options);
  const Status opened = decoder.open(std::move(source));
  if (!opened.ok()) {
    if (opened.code() == L4D_ERR_IO || opened.code() == L4D_ERR_OUT_OF_MEMORY ||
        opened.code() == L4D_ERR_LIMIT_EXCEEDED) {
      return opened;
    }
    report(opened);
    return {};
  }
  // The reference loops: what a validator finds must not depend on the machine.
  PageDecoder pages(decoder.file(), decode_kernels_reference(), static_cast<int>(options.threads));
  return Validator(decoder.file(), pages, options, report).run();
}

}  // namespace l4d
