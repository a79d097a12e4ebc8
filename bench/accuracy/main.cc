// SPDX-License-Identifier: Apache-2.0
// Quality against time and bytes, section by section, into one JSON document. Sections of a
// document that is there already and are not run stay in it.
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>

#include "bench/accuracy/document.h"
#include "bench/accuracy/sections.h"
#include "bench/accuracy/timing.h"

namespace {

using namespace l4d;
using namespace l4d::bench;

struct Section {
  const char* name;
  Json (*run)(Bench&);
  bool needs_device = false;  // left out where there is none, unless it is asked for by name
};
constexpr Section kSections[] = {
    {"presets", run_presets},
    {"jod", run_jod},
    {"device", run_device, true},
    {"ways", run_ways},
    {"device-ways", run_device_ways, true},
    {"final", run_final},
    {"rate", run_rate},
    {"sensitivity", run_sensitivity},
    {"effort", run_effort},
    {"decoder", run_decoder},
    {"renderer", run_renderer},
    {"stages", run_stages},
    {"ablation", run_ablation},
    {"codebooks", run_codebooks},
    {"thresholds", run_thresholds},
    {"rcq", run_rcq},
    {"effects", run_effects},
};

void usage(std::FILE* to) {
  std::fputs(
      "usage: bench_accuracy [--quick] [--only SECTION[,SECTION...]] [--json FILE]\n"
      "                      [--gaussians N] [--rows N]\n\n"
      "--gaussians: of the scenes of a quick run; --rows: at most so many rows of a sweep\n"
      "sections:",
      to);
  for (const Section& s : kSections) std::fprintf(to, " %s", s.name);
  std::fputs("\n", to);
}

bool has_device() {
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  options.backend = L4D_BACKEND_CUDA;
  l4d_decoder* decoder = nullptr;
  const bool found = l4d_decoder_create(&options, &decoder) == L4D_OK;
  l4d_decoder_destroy(decoder);
  return found;
}

std::string cpu_model() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);) {
    const size_t colon = line.find(": ");
    if (line.compare(0, 10, "model name") == 0 && colon != std::string::npos) {
      return line.substr(colon + 2);
    }
  }
  return "unknown";
}

struct Arguments {
  BenchOptions options;
  std::string json;
  std::vector<const Section*> sections;
};

// False where the arguments are none.
bool parse(int argc, char** argv, Arguments* out) {
  std::string only;
  bool rows_given = false;
  for (int i = 1; i < argc; ++i) {
    const std::string a = argv[i];
    if (a == "--quick") {
      out->options.quick = true;
      continue;
    }
    if (i + 1 >= argc) return false;
    const std::string value = argv[++i];
    try {
      if (a == "--only") {
        only = value;
      } else if (a == "--json") {
        out->json = value;
      } else if (a == "--gaussians") {
        out->options.gaussians = std::stoull(value);
      } else if (a == "--rows") {
        out->options.max_rows = std::stoull(value);
        rows_given = true;
      } else {
        return false;
      }
    } catch (const std::logic_error&) {
      return false;
    }
  }
  if (out->options.quick && !rows_given) out->options.max_rows = 4;
  if (out->options.max_rows == 0 || out->options.gaussians < 1000) return false;
  if (out->json.empty()) {
    out->json = out->options.quick ? "build/accuracy/quick.json" : "docs/accuracy/results.json";
  } else {  // weights beside results that somebody put elsewhere
    const std::filesystem::path folder = std::filesystem::path(out->json).parent_path();
    out->options.cache_dir = folder.empty() ? "." : folder.string();
  }
  std::istringstream names(only);
  for (std::string name; std::getline(names, name, ',');) {
    size_t found = 0;
    for (const Section& s : kSections) {
      if (name == s.name) {
        out->sections.push_back(&s);
        ++found;
      }
    }
    if (found == 0) return false;
  }
  if (only.empty()) {
    for (const Section& s : kSections) {
      if (s.needs_device && !has_device()) {
        std::fprintf(stderr, "bench_accuracy: no CUDA device, section %s is left out\n", s.name);
      } else {
        out->sections.push_back(&s);
      }
    }
  }
  return true;
}

void run(const Arguments& arguments) {
  Json document = {{"schema", "l4dcodec.accuracy/1"},
                   {"quick", arguments.options.quick},
                   {"sections", Json::object()}};
  if (std::ifstream in(arguments.json); in) {
    const Json before = Json::parse(in);
    if (before.value("schema", "") == document["schema"] &&
        before.value("quick", false) == arguments.options.quick) {
      document = before;
    }
  }
  Bench bench(arguments.options);
  for (const Section* section : arguments.sections) {
    bench.begin(section->name);
    const double started = seconds_now();
    const BenchScene& scene = bench.real();
    Json tables = section->run(bench);
    document["sections"][section->name] = {
        {"command", "./dev bench accuracy" +
                        std::string(arguments.options.quick ? " --quick" : "") + " --only " +
                        section->name},
        {"seconds", seconds_now() - started},
        {"scene", scene.name},
        {"gaussians", scene.scene.count()},
        {"machine", {{"cpu", cpu_model()}, {"cores", std::thread::hardware_concurrency()}}},
        {"version", l4d_version_string()},
        {"build", l4d_build_info()},
        {"tables", std::move(tables)}};
    write_document(arguments.json, document);  // what is done survives a failure of the next
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::strcmp(argv[1], "--help") == 0) {
    usage(stdout);
    return 0;
  }
  Arguments arguments;
  if (!parse(argc, argv, &arguments)) {
    usage(stderr);
    return 2;
  }
  try {
    run(arguments);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "bench_accuracy: %s\n", e.what());
    return 1;
  }
  return 0;
}
