// SPDX-License-Identifier: Apache-2.0
// Pages to attribute arrays, in parallel. The arrays are disjoint per page, so neither the number
// of threads nor the order of pages changes a bit.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "decoder/expand/expand.h"
#include "decoder/expand/page_rules.h"
#include "decoder/read/losses.h"
#include "decoder/read/plan.h"
#include "l4d/experimental/packed.h"
#include "libl4dcodec/container/page.h"

namespace l4d {

// The loops of one backend.
struct DecodeKernels {
  const StreamKernels* stream;
  const RansKernels* rans;
  ExpandKernels expand;
};
DecodeKernels decode_kernels_reference();
DecodeKernels decode_kernels_simd();

// The rows of a page that its rules are about.
struct RuleRows {
  std::vector<float> position, log_scale, rotor;
  std::vector<double> mean_t;
  std::vector<uint32_t> window;
  std::vector<Slice4D<double>> slices;
  static constexpr uint64_t kBytesPerGaussian =
      15 * sizeof(float) + sizeof(double) + 2 * sizeof(uint32_t) + sizeof(Slice4D<double>);
};

// Per-thread working memory.
struct PageScratch {
  StreamDecoder stream;
  RansDecoder rans;
  PageColumns columns;
  Bytes storage;
  ExpandScratch expand;
  RuleRows rules;
};

class PageDecoder {
 public:
  using Progress = std::function<bool(uint64_t done, uint64_t total)>;  // false = cancel

  PageDecoder(SceneFile& file, const DecodeKernels& kernels, int threads)
      : file_(file), kernels_(kernels), threads_(threads) {}

  // With `lost`, pages that cannot be read or are damaged are listed there and the rows they would
  // fill stay as they are; without, one of them ends the call. A page of which the SH chunk
  // alone cannot be read is listed as such, and its rows have SH without detail.

  // Expands tasks [begin, end) of the plan into `out`, whose arrays hold at least
  // plan.num_gaussians.
  Status expand(const Plan& plan, size_t begin, size_t end, const l4d_gaussian_buffers& out,
                const Progress& progress, LostPages* lost);
  // The packed form; escape arrays are filled in stored order.
  Status pack(const Plan& plan, l4d_packed_buffers& out, const Progress& progress, LostPages* lost);
  // Decodes nothing: lists the pages that cannot be decoded.
  Status probe(const Plan& plan, LostPages* lost);
  // Decodes all of one page, without its SH chunk if not `with_detail`, and checks the rules of
  // check_page_rules, too. What is wrong goes to `lost`; other failures concern the call.
  Status prove(const Plan& plan, size_t task, bool with_detail, LostPages* lost);
  // Parses every page for its section bytes and rules alone.
  Status measure(const Plan& plan, SectionBytes* sections, std::vector<uint64_t>* layer_bytes);

  uint64_t pages_decoded() const { return pages_decoded_; }
  // Of rANS.
  uint64_t symbols_decoded() const { return symbols_decoded_.load(std::memory_order_relaxed); }

 private:
  // Pages [begin, end) of a plan, and what is wanted of them.
  struct Pages {
    const Plan& plan;
    size_t begin, end;
    PageWants wants;
    LostPages* lost = nullptr;
    bool need_codebooks = true;
    SectionBytes* sections = nullptr;  // added to
    bool check_rules = false;
    bool with_detail() const { return wants.sh && wants.sh_detail; }
  };
  struct Batch;
  struct Parsing;
  using PageBody = std::function<void(size_t task, const PageColumns& columns,
                                      const PageCodebooks& codebooks, PageScratch& scratch)>;
  // Reads pages in batches, checks and parses them in parallel and hands their columns to `body`.
  Status for_each_page(const Pages& pages, const Progress& progress, const PageBody& body);
  // What every page of a stream needs: without it there is nothing to go on with.
  Status load_shared_codebooks(const Pages& pages);
  // What the pages of a batch need besides their bytes.
  Status find_tables(const Pages& pages, Batch* batch);
  void decode_batch(const Pages& pages, const PageBody& body, Batch* batch);
  // The first failure that ends the call; the others go to pages.lost.
  Status collect_failures(const Pages& pages, Batch* batch);
  // Checks a page; parses one that is not coded by rANS, and says of others what there is to parse.
  Status start_page(const Pages& pages, size_t i, Parsing* page, Batch* batch);
  void start_rans_page(const Pages& pages, size_t i, Parsing* page, Batch* batch);
  // Pages [first, last) of the batch, at most two.
  void parse_pages(const Pages& pages, size_t first, size_t last, Parsing* parsing, Batch* batch);
  // Counts a parsed page and checks its rules.
  Status finish_page(const Pages& pages, size_t i, PageScratch& scratch, const Batch& batch);
  Status check_rules(const Pages& pages, size_t i, PageScratch& scratch, const Batch& batch);
  Status resolve_codebooks(const PageTask& task, const PageWants& wants, PageCodebooks* out);
  std::unique_ptr<PageScratch> take_scratch();
  void give_scratch(std::unique_ptr<PageScratch> scratch);

  SceneFile& file_;
  const DecodeKernels kernels_;
  int threads_;
  uint64_t pages_decoded_ = 0;
  std::atomic<uint64_t> symbols_decoded_{0};
  std::mutex scratch_mutex_;
  std::vector<std::unique_ptr<PageScratch>> scratch_;
};

}  // namespace l4d
