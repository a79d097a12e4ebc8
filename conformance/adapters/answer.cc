// SPDX-License-Identifier: Apache-2.0
// The contract of the suite as a program on the library's public API, for machines where the tool
// l4dcodec does not run:
//
//   answer [--backend cpu|reference|cuda] --query QUERY [--level N] [--tier N] [--detail base]
//          [--packed] FILE
//   answer [--backend cpu|reference|cuda] --batch
//
// --batch reads questions from standard input, a line each: arguments and file, between tabs. It
// prints for each the exit status, a tab and the answer. One program then answers the whole suite,
// so a decoder that leaves something behind for the next stream shows here.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "conformance/adapters/digests.h"
#include "l4d/cuda.h"
#include "l4d/decode.hpp"
#include "l4d/experimental/inspect.hpp"

namespace {

using Bytes = std::vector<unsigned char>;

struct Question {
  std::string query;
  uint32_t max_level = UINT32_MAX;
  uint32_t max_tier = UINT32_MAX;
  bool base = false, packed = false;
  std::string file;
};

struct Answer {
  int status = 0;
  std::string json;
};

// ---- refusals ----

const char* kind_of(l4d_status status) {
  switch (status) {
    case L4D_ERR_NOT_L4D:
      return "no-l4d";
    case L4D_ERR_VERSION_UNSUPPORTED:
      return "version";
    case L4D_ERR_FEATURE_UNSUPPORTED:
      return "feature";
    case L4D_ERR_TRUNCATED:
      return "truncated";
    case L4D_ERR_CHECKSUM:
      return "checksum";
    case L4D_ERR_CORRUPT:
      return "rule";
    case L4D_ERR_LIMIT_EXCEEDED:
      return "limit";
    default:
      return nullptr;
  }
}

// The rule that a message names: "... (spec PAGE-1 ...".
std::string clause_in(const std::string& message) {
  const size_t at = message.find("spec ");
  if (at == std::string::npos) return "";
  const size_t begin = at + 5;
  const size_t end = message.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZ-0123456789", begin);
  const std::string word = message.substr(begin, end - begin);
  return word.find('-') == std::string::npos ? "" : word;
}

Answer refused(l4d_status status, const std::string& clause) {
  const char* kind = kind_of(status);
  if (clause.empty() && kind == nullptr) throw std::runtime_error(l4d_status_name(status));
  return {1, "{\"refused\": \"" + (clause.empty() ? std::string(kind) : clause) + "\"}"};
}

// ---- questions ----

struct FirstViolation {
  bool found = false;
  l4d_status status = L4D_OK;
  std::string clause;
};

void keep_first(void* user, const l4d_violation* violation) {
  auto* first = static_cast<FirstViolation*>(user);
  if (first->found) return;
  *first = {true, violation->status, violation->clause};
}

int64_t read_at(void* user, void* to, size_t n, uint64_t offset) {
  const auto& file = *static_cast<const Bytes*>(user);
  if (offset >= file.size()) return 0;
  n = std::min<size_t>(n, file.size() - static_cast<size_t>(offset));
  std::memcpy(to, file.data() + offset, n);
  return static_cast<int64_t>(n);
}

int64_t size_of(void* user) {
  return static_cast<int64_t>(static_cast<const Bytes*>(user)->size());
}

Answer validate(Bytes* file, l4d_decoder_options options) {
  options.accept_needs = 1;  // a member is whole without those that it needs
  l4d_reader reader = L4D_INIT(l4d_reader);
  reader.user = file;
  reader.read_at = &read_at;
  reader.size = &size_of;
  FirstViolation first;
  uint64_t count = 0;
  const l4d_status status = l4d_validate(&reader, &options, &keep_first, &first, &count);
  if (status != L4D_OK) return refused(status, clause_in(l4d_last_error_message()));
  if (count > 0) return refused(first.status, first.clause);
  return {0, "{\"valid\": true}"};
}

std::string demand_of(const l4d::DecoderHandle& decoder) {
  const l4d_stream_demand d = stream_demand(decoder);
  const auto item = [](const char* name, uint64_t value) {
    return "\"" + std::string(name) + "\": " + std::to_string(value);
  };
  return "{\"demand\": {" + item("profile", d.profile) + ", " + item("level", d.level) + ", " +
         item("gaussians", d.instant_gaussians) + ", " + item("table_bytes", d.table_bytes) + ", " +
         item("instant_bytes", d.instant_bytes) + ", " + item("start_bytes", d.start_bytes) + ", " +
         item("memory_bytes", d.memory_bytes) + ", " + item("symbols", d.instant_symbols) + "}}";
}

double number(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0') throw std::runtime_error("no number: " + text);
  return value;
}

l4d_query query_of(const Question& q) {
  l4d_query out = L4D_INIT(l4d_query);
  const size_t colon = q.query.find(':');
  const std::string kind = q.query.substr(0, colon);
  const std::string rest = colon == std::string::npos ? "" : q.query.substr(colon + 1);
  const size_t second = rest.find(':');
  if (kind == "all" && rest.empty()) {
    out.kind = L4D_QUERY_ALL;
  } else if (kind == "time") {
    out.kind = L4D_QUERY_TIME;
    out.time_begin = number(rest);
  } else if (kind == "range" && second != std::string::npos) {
    out.kind = L4D_QUERY_RANGE;
    out.time_begin = number(rest.substr(0, second));
    out.time_end = number(rest.substr(second + 1));
  } else {
    throw std::runtime_error("no query: " + q.query);
  }
  out.point.levels = q.max_level + 1;  // UINT32_MAX: 0, which is all
  out.point.tiers = q.max_tier + 1;
  if (q.base) out.point.detail = L4D_DETAIL_BASE_COLOR;
  return out;
}

Bytes read_file(const std::string& path) {
  std::FILE* file = std::fopen(path.c_str(), "rb");
  if (file == nullptr) throw std::runtime_error("cannot open " + path);
  Bytes out;
  unsigned char piece[65536];
  size_t n;
  while ((n = std::fread(piece, 1, sizeof piece, file)) > 0)
    out.insert(out.end(), piece, piece + n);
  const bool failed = std::ferror(file) != 0;
  std::fclose(file);
  if (failed) throw std::runtime_error("cannot read " + path);
  return out;
}

Answer answer_of(const Question& q, uint32_t backend) {
  Bytes file = read_file(q.file);
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  options.threads = 1;
  options.backend = backend;
  if (q.query == "validate") return validate(&file, options);
  try {
    l4d::DecoderHandle decoder(&options);
    decoder.open_memory(file.data(), file.size());
    if (q.query == "demand") return {0, demand_of(decoder)};
    const l4d_query query = query_of(q);
    return {
        0, q.packed ? l4d::packed_digests(decoder, query) : l4d::attribute_digests(decoder, query)};
  } catch (const l4d::Error& error) {
    return refused(error.status(), clause_in(error.what()));
  }
}

Question question_of(const std::vector<std::string>& words) {
  Question out;
  for (size_t i = 0; i + 1 < words.size(); ++i) {
    const std::string& word = words[i];
    if (word == "--packed") {
      out.packed = true;
      continue;
    }
    if (i + 2 >= words.size()) throw std::runtime_error("no value for " + word);
    const std::string& value = words[++i];
    if (word == "--query") {
      out.query = value;
    } else if (word == "--level") {
      out.max_level = static_cast<uint32_t>(number(value));
    } else if (word == "--tier") {
      out.max_tier = static_cast<uint32_t>(number(value));
    } else if (word == "--detail" && value == "base") {
      out.base = true;
    } else {
      throw std::runtime_error("unknown argument " + word);
    }
  }
  if (words.empty() || out.query.empty()) throw std::runtime_error("no question");
  out.file = words.back();
  return out;
}

// 3 where the question itself fails, which is no refusal.
Answer answer(const std::vector<std::string>& words, uint32_t backend) {
  try {
    return answer_of(question_of(words), backend);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "answer: %s\n", error.what());
    return {3, "{}"};
  }
}

bool read_line(std::string* line) {
  line->clear();
  for (int c = std::getchar(); c != EOF; c = std::getchar()) {
    if (c == '\n') return true;
    if (c != '\r') line->push_back(static_cast<char>(c));
  }
  return !line->empty();
}

// False where there is no such back end: a suite that the host answers says nothing of a device.
bool find_backend(const std::string& name, uint32_t* backend) {
  if (name == "cpu") {
    *backend = L4D_BACKEND_CPU;
  } else if (name == "reference") {
    *backend = L4D_BACKEND_REFERENCE;
  } else if (name == "cuda") {
    uint32_t devices = 0;
    if (l4d_cuda_get_device_count(&devices) != L4D_OK || devices == 0) {
      std::fprintf(stderr, "answer: no CUDA device\n");
      return false;
    }
    *backend = L4D_BACKEND_CUDA;
  } else {
    std::fprintf(stderr, "answer: unknown backend %s\n", name.c_str());
    return false;
  }
  return true;
}

int run_batch(uint32_t backend) {
  std::string line;
  while (read_line(&line)) {
    std::vector<std::string> words(1);
    for (const char c : line) {
      if (c == '\t') {
        words.emplace_back();
      } else {
        words.back().push_back(c);
      }
    }
    const Answer a = answer(words, backend);
    std::printf("%d\t%s\n", a.status, a.json.c_str());
    std::fflush(stdout);
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::string> words(argv + 1, argv + argc);
  uint32_t backend = L4D_BACKEND_CPU;
  if (words.size() >= 2 && words[0] == "--backend") {
    if (!find_backend(words[1], &backend)) return 3;
    words.erase(words.begin(), words.begin() + 2);
  }
  if (words == std::vector<std::string>{"--batch"}) return run_batch(backend);
  const Answer a = answer(words, backend);
  std::printf("%s\n", a.json.c_str());
  return a.status;
}
