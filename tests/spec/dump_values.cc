// SPDX-License-Identifier: Apache-2.0
// What the library makes of a stream, in the words of spec/examples/decode_tiny.py, so that a
// script can compare them:
//   dump_values reference|cpu FILE...     every value as bits of its binary32
//   dump_values SECONDS FILE...           the values of what a query for that time selects
//   dump_values validate FILE...          the clause of each violation
//   dump_values demand FILE...            what playing it asks for; a rate of 1000 bytes/s leaves
// Per file one line "file NAME", then the values or clauses, or "error STATUS CLAUSE".
#include <cinttypes>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "l4d/decode.h"
#include "l4d/experimental/inspect.h"

namespace {

using Bytes = std::vector<char>;

// The clause is only told to people, in the detail: "spec PAGE-1 at byte 7: ...".
void print_error(l4d_status status, const std::string& detail) {
  std::string clause = "-";
  if (detail.rfind("spec ", 0) == 0) clause = detail.substr(5, detail.find_first_of(" :", 5) - 5);
  std::printf("error %s %s\n", l4d_status_name(status), clause.c_str());
}

void print_rows(const char* name, const std::vector<float>& values, size_t i, size_t dim) {
  for (size_t k = 0; k < dim; ++k) {
    uint32_t bits;
    std::memcpy(&bits, &values[i * dim + k], sizeof bits);
    std::printf("%s %zu %zu %08" PRIx32 "\n", name, i, k, bits);
  }
}

// Prints "%s i k bits" in the order of decode_tiny.py: Gaussian, attribute, number.
l4d_status dump(l4d_decoder* decoder, const Bytes& file, const l4d_query& query) {
  l4d_status status = l4d_decoder_open_memory(decoder, file.data(), file.size());
  if (status != L4D_OK) return status;
  l4d_info info = L4D_INIT(l4d_info);
  status = l4d_decoder_get_info(decoder, &info);
  if (status != L4D_OK) return status;
  const size_t n = static_cast<size_t>(info.num_gaussians);
  const size_t sh_dim = size_t{3} * (info.sh_degree + 1) * (info.sh_degree + 1);
  std::vector<float> position(3 * n), mean(n), local(n), log_scale(4 * n), rotor(8 * n), opacity(n),
      sh(sh_dim * n);
  std::vector<double> exact(n);
  std::vector<uint32_t> window(2 * n);
  l4d_gaussian_buffers out = L4D_INIT(l4d_gaussian_buffers);
  out.capacity = n;
  out.position = position.data();
  out.mean_t = mean.data();
  out.mean_t_local = local.data();
  out.mean_t_double = exact.data();
  out.window = window.data();
  out.log_scale = log_scale.data();
  out.rotor = rotor.data();
  out.opacity = opacity.data();
  out.sh = sh.data();
  status = l4d_decoder_decode(decoder, &query, &out);
  if (status != L4D_OK) return status;
  for (size_t i = 0; i < static_cast<size_t>(out.count); ++i) {
    print_rows("position", position, i, 3);
    print_rows("mean_t_local", local, i, 1);
    print_rows("mean_t", mean, i, 1);
    uint64_t exact_bits;
    std::memcpy(&exact_bits, &exact[i], sizeof exact_bits);
    std::printf("mean_t_double %zu 0 %016" PRIx64 "\n", i, exact_bits);
    print_rows("log_scale", log_scale, i, 4);
    print_rows("rotor", rotor, i, 8);
    print_rows("opacity", opacity, i, 1);
    print_rows("sh", sh, i, sh_dim);
    for (size_t k = 0; k < 2 && window[2 * i + 1] != 0; ++k) {
      std::printf("window %zu %zu %08" PRIx32 "\n", i, k, window[2 * i + k]);
    }
  }
  return L4D_OK;
}

l4d_status measure(l4d_decoder* decoder, const Bytes& file) {
  l4d_status status = l4d_decoder_open_memory(decoder, file.data(), file.size());
  if (status != L4D_OK) return status;
  l4d_stream_demand c = L4D_INIT(l4d_stream_demand);
  c.bytes_per_second = 1000;
  status = l4d_decoder_get_stream_demand(decoder, &c);
  if (status != L4D_OK) return status;
  const auto print = [](const char* name, uint64_t value) {
    std::printf("%s %" PRIu64 "\n", name, value);
  };
  print("profile", c.profile);
  print("level", c.level);
  print("gaussians", c.instant_gaussians);
  print("table_bytes", c.table_bytes);
  print("instant_bytes", c.instant_bytes);
  print("start_bytes", c.start_bytes);
  print("memory_bytes", c.memory_bytes);
  print("symbols", c.instant_symbols);
  print("burst_bytes", c.min_burst_bytes);
  return L4D_OK;
}

void validate(const Bytes& file) {
  l4d_reader reader = L4D_INIT(l4d_reader);
  reader.user = const_cast<Bytes*>(&file);
  reader.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
    std::memcpy(dst, static_cast<Bytes*>(user)->data() + offset, n);
    return static_cast<int64_t>(n);
  };
  reader.size = [](void* user) { return static_cast<int64_t>(static_cast<Bytes*>(user)->size()); };
  uint64_t violations = 0;
  const l4d_status status = l4d_validate(
      &reader, nullptr,
      [](void*, const l4d_violation* v) { std::printf("violation %s\n", v->clause); }, nullptr,
      &violations);
  if (status != L4D_OK) std::printf("error %s -\n", l4d_status_name(status));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  const std::string mode = argv[1];
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  options.threads = 2;
  options.backend = mode == "reference" ? L4D_BACKEND_REFERENCE : L4D_BACKEND_CPU;
  l4d_query query = L4D_INIT(l4d_query);
  if (mode == "base") {
    query.point.detail = L4D_DETAIL_BASE_COLOR;
  } else if (mode != "reference" && mode != "cpu" && mode != "validate" && mode != "demand") {
    query.kind = L4D_QUERY_TIME;
    query.time_begin = std::stod(mode);
  }
  l4d_decoder* decoder = nullptr;
  if (l4d_decoder_create(&options, &decoder) != L4D_OK) return 1;
  for (int i = 2; i < argc; ++i) {
    std::ifstream in(argv[i], std::ios::binary);
    const Bytes file((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
    std::printf("file %s\n", argv[i]);
    if (mode == "validate") {
      validate(file);
      continue;
    }
    const l4d_status status =
        mode == "demand" ? measure(decoder, file) : dump(decoder, file, query);
    if (status != L4D_OK) print_error(status, l4d_last_error_message());
  }
  l4d_decoder_destroy(decoder);
  return 0;
}
