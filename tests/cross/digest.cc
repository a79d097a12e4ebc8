// SPDX-License-Identifier: Apache-2.0
// digest FILE...: for each stream and both backends of the host, a line with a hash of all decoded
// arrays for each of a few queries, or with the error that the query ends in. A stream decodes to
// the same lines wherever this runs. digest --bench FILE...: milliseconds that decoding all of each
// stream takes on one thread.
#include <algorithm>
#include <chrono>
#include <cinttypes>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include "l4d/decode.hpp"
#include "libl4dcodec/base/hash.h"

namespace {

using Content = std::vector<unsigned char>;

bool read_file(const char* path, Content& content) {
  std::FILE* file = std::fopen(path, "rb");
  if (file == nullptr) return false;
  unsigned char piece[65536];
  size_t n;
  while ((n = std::fread(piece, 1, sizeof piece, file)) > 0) {
    content.insert(content.end(), piece, piece + n);
  }
  const bool good = std::ferror(file) == 0;
  return std::fclose(file) == 0 && good;
}

uint64_t hash_of(const l4d::GaussianArrays& a) {
  uint64_t h = a.position.size() / 3;
  for (const std::vector<float>* v :
       {&a.position, &a.mean_t, &a.mean_t_local, &a.log_scale, &a.rotor, &a.opacity, &a.sh}) {
    const auto* bytes = reinterpret_cast<const unsigned char*>(v->data());
    h = h * 0x9e3779b97f4a7c15u + l4d::hash64(l4d::ByteSpan(bytes, v->size() * sizeof(float)));
  }
  return h;
}

l4d_query query_of(uint32_t kind) {
  l4d_query query = L4D_INIT(l4d_query);
  query.kind = kind;
  return query;
}

struct NamedQuery {
  const char* name;
  l4d_query query;
};

std::vector<NamedQuery> queries_of(const l4d_info& info) {
  const double begin = info.timeline.time_begin;
  NamedQuery time{"time", query_of(L4D_QUERY_TIME)};
  time.query.time_begin = begin + 0.37 * info.duration;
  NamedQuery range{"range", query_of(L4D_QUERY_RANGE)};
  range.query.time_begin = begin + 0.2 * info.duration;
  range.query.time_end = begin + 0.6 * info.duration;
  NamedQuery base{"base_color", query_of(L4D_QUERY_ALL)};
  base.query.point.detail = L4D_DETAIL_BASE_COLOR;
  return {{"all", query_of(L4D_QUERY_ALL)}, time, range, base};
}

// Prints what decode() returns, or the error it throws.
template <typename Decode>
void print_line(const char* name, const char* backend, const char* query, const Decode& decode) {
  try {
    const l4d::GaussianArrays arrays = decode();
    std::printf("%s %s %s %zu %016" PRIx64 "\n", name, backend, query, arrays.position.size() / 3,
                hash_of(arrays));
  } catch (const l4d::Error& error) {
    std::printf("%s %s %s %s\n", name, backend, query, error.what());
  }
}

void print_digest(const char* name, const Content& content) {
  for (const bool reference : {true, false}) {
    const char* backend = reference ? "reference" : "simd";
    l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
    options.threads = 1;
    options.backend = reference ? L4D_BACKEND_REFERENCE : L4D_BACKEND_CPU;
    l4d::DecoderHandle decoder(&options);
    std::vector<NamedQuery> queries;
    print_line(name, backend, "open", [&] {
      decoder.open_memory(content.data(), content.size());
      queries = queries_of(decoder.info());
      return l4d::GaussianArrays();
    });
    for (const NamedQuery& q : queries) {
      print_line(name, backend, q.name, [&] { return decoder.decode(q.query); });
    }
  }
}

void print_time(const char* name, const Content& content) {
  using Clock = std::chrono::steady_clock;
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  options.threads = 1;
  double best = 1e30;
  for (int round = 0; round < 9; ++round) {
    l4d::DecoderHandle decoder(&options);
    decoder.open_memory(content.data(), content.size());
    const auto begin = Clock::now();
    decoder.decode(query_of(L4D_QUERY_ALL));
    best = std::min(best, std::chrono::duration<double, std::milli>(Clock::now() - begin).count());
  }
  std::printf("%s %.1f\n", name, best);
}

}  // namespace

int main(int argc, char** argv) {
  const bool bench = argc > 1 && std::strcmp(argv[1], "--bench") == 0;
  for (int i = bench ? 2 : 1; i < argc; ++i) {
    Content content;
    if (!read_file(argv[i], content)) {
      std::fprintf(stderr, "cannot read %s\n", argv[i]);
      return 1;
    }
    const char* slash = std::strrchr(argv[i], '/');
    const char* name = slash == nullptr ? argv[i] : slash + 1;
    bench ? print_time(name, content) : print_digest(name, content);
  }
  return 0;
}
