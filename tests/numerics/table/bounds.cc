// SPDX-License-Identifier: Apache-2.0
// Whether the units of a scene matter: the hard scenes, and real ones where they are, are coded by
// every preset in other units and at other times, and compared in double precision by formulas that
// are not the library's. Prints a Markdown table. Exit status 1 if a stream is not valid, or an
// error is beyond what the stream states or beyond its bound.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <map>
#include <string>

#include "io/ply/scene_ply.h"
#include "l4d/experimental/inspect.h"
#include "tests/common/codec.h"
#include "tests/numerics/hard_scenes.h"
#include "tests/numerics/oracle.h"

namespace {

using namespace l4d;
using namespace l4d::numerics;
using namespace l4d::test;

constexpr char kUsage[] =
    "usage: l4d_bounds [--every N] [--presets NAME[,NAME...]] [--sections]\n"
    "--every: of real scenes every Nth Gaussian (1). --sections: also the bytes of each section, "
    "and\n"
    "how they change in parts of all. Real scenes: of $L4D_DATA_DIR, else of ../shared/data.\n";

constexpr const char* kPresets[] = {"tiny",    "small",        "default",
                                    "large",   "archive",      "indexed-small",
                                    "indexed", "indexed-high", "lossless"};
constexpr struct {
  double scale, later;
} kUnits[] = {{1, 0}, {1, 1e5}, {1e-3, 0}, {1e-3, 1e5}, {1e3, 0}, {1e3, 1e5}};
// Below this, real scenes would be below the limit of log scales at a scale of 1e-3.
constexpr float kLeastLogScale = -10;
// The oracle samples instants, and lets permanent Gaussians fade by up to a thousandth.
constexpr double kOpacitySlack = 1e-3;

struct Options {
  size_t every = 1;
  std::string presets;
  bool sections = false;
};

struct NamedScene {
  std::string name;
  TestScene scene;
  bool real = false;
};

// With positions at reference times, as the oracle wants them.
TestScene real_scene(const std::string& path, size_t every) {
  const io::Scene from = io::read_scene_ply(path);
  TestScene to;
  to.timeline = from.timeline;
  to.sh_degree = from.sh_degree;
  const double begin = from.timeline.time_begin;
  const double end = begin + to.duration();
  const size_t dim = to.sh_dim();
  for (size_t i = 0; i < from.count(); i += every) {
    const auto add = [i](std::vector<float>& rows, const std::vector<float>& all, size_t n) {
      rows.insert(rows.end(), all.begin() + static_cast<std::ptrdiff_t>(n * i),
                  all.begin() + static_cast<std::ptrdiff_t>(n * (i + 1)));
    };
    add(to.position, from.position, 3);
    add(to.mean_t, from.mean_t, 1);
    add(to.log_scale, from.log_scale, 4);
    add(to.rotor, from.rotor, 8);
    add(to.opacity, from.opacity, 1);
    add(to.sh, from.sh, dim);
    const size_t j = to.count() - 1;
    if ((from.flags & L4D_OPACITY_LOGIT) != 0) to.opacity[j] = 1 / (1 + std::exp(-to.opacity[j]));
    for (size_t k = 0; k < 3; ++k) {
      to.log_scale[4 * j + k] = std::max(to.log_scale[4 * j + k], kLeastLogScale);
    }
    if ((from.flags & L4D_POSITION_AT_MEAN_TIME) == 0) continue;
    const Seen seen = seen_of(&to.position[3 * j], static_cast<double>(to.mean_t[j]),
                              &to.log_scale[4 * j], &to.rotor[8 * j], 1, begin, end);
    for (size_t k = 0; k < 3; ++k) {
      to.position[3 * j + k] +=
          static_cast<float>(seen.velocity[static_cast<int>(k)] * (seen.reference - seen.mean));
    }
  }
  return to;
}

std::vector<NamedScene> all_scenes(const Options& options) {
  std::vector<NamedScene> out;
  for (const HardScene& hard : hard_scenes()) out.push_back({hard.name, hard.make(), false});
  const char* given = std::getenv("L4D_DATA_DIR");
  const std::string folder = given != nullptr ? given : "../shared/data";
  for (const char* name :
       {"basketball/basketball.ply", "statues/angel.ply", "statues/trumpet.ply"}) {
    const std::string path = folder + "/" + name;
    if (!std::filesystem::exists(path)) {
      std::fprintf(stderr, "%s is not there: left out\n", path.c_str());
      continue;
    }
    out.push_back({name, real_scene(path, options.every), true});
  }
  return out;
}

using Sections = std::array<uint64_t, L4D_SECTION_COUNT>;

// A row of the table: of all scenes.
struct Row {
  size_t valid = 0, scenes = 0;
  Worst worst;
  l4d_coding_errors bound{};
  double bytes[2] = {0, 0};  // of hard scenes, of real ones
  Sections sections[2] = {};
  uint64_t escapes[2] = {0, 0};
};

class Table {
 public:
  bool all_kept() const { return kept_; }

  void add(const NamedScene& scene, const TestScene& other, const char* preset, Row* row) {
    EncodeOptions options;
    options.preset = preset;
    options.rans = true;
    options.threads = 0;
    const Encoded e = encode(other, options);
    const std::string what = scene.name + " " + preset;
    ++row->scenes;
    const std::vector<Violation> violations = validate(e.bytes);
    if (violations.empty()) ++row->valid;
    for (const Violation& v : violations) miss(what + ": " + v.clause + " " + v.message);
    const Worst worst = worst_errors(other, e);
    const l4d_coding_errors stated = stated_errors(e.bytes);
    hold(what + ": position", worst.position, stated.position, stated.position_bound, 0);
    hold(what + ": covariance", worst.covariance, stated.covariance, stated.covariance_bound, 0);
    hold(what + ": opacity", worst.opacity, stated.opacity, stated.opacity_bound, kOpacitySlack);
    hold(what + ": base colour", worst.base_color, stated.base_color, stated.base_color_bound, 0);
    hold(what + ": directional colour", worst.directional_color, stated.directional_color,
         stated.directional_color_bound, 0);
    Worst& w = row->worst;
    w.position = std::max(w.position, worst.position);
    w.covariance = std::max(w.covariance, worst.covariance);
    w.opacity = std::max(w.opacity, worst.opacity);
    w.base_color = std::max(w.base_color, worst.base_color);
    w.directional_color = std::max(w.directional_color, worst.directional_color);
    row->bound = stated;
    const size_t kind = scene.real ? 1 : 0;
    row->bytes[kind] += static_cast<double>(e.bytes.size());
    row->escapes[kind] += e.report.escapes;
    DecoderHandle decoder;
    decoder.open_memory(e.bytes.data(), e.bytes.size());
    Sections sections;
    decoder.check(l4d_decoder_get_sections(decoder.get(), sections.data(), sections.size(), nullptr,
                                           nullptr, 0));
    for (size_t s = 0; s < sections.size(); ++s) row->sections[kind][s] += sections[s];
  }

 private:
  void miss(const std::string& what) {
    kept_ = false;
    std::fprintf(stderr, "%s\n", what.c_str());
  }
  // The oracle computes in another order: errors agree to 1e-4.
  void hold(const std::string& what, double worst, double stated, double bound, double slack) {
    const double factor = 1 + 1e-4;
    const auto told = [&](const char* than, double limit) {
      miss(what + " " + std::to_string(worst) + " is above the " + than + " " +
           std::to_string(limit));
    };
    if (worst > stated * factor + slack + 1e-6) told("stated error", stated);
    if (bound > 0 && worst > bound * factor + slack) told("bound", bound);
    if (bound > 0 && stated > bound) told("bound of the stated error", bound);
  }

  bool kept_ = true;
};

std::string of_bound(double worst, double bound) {
  char text[64];
  if (bound > 0) {
    std::snprintf(text, sizeof text, "%.3g of %.3g", worst, bound);
  } else {
    std::snprintf(text, sizeof text, "%.3g", worst);
  }
  return text;
}

std::string change(double bytes, double before) {
  if (before == 0) return "";
  char text[64];
  std::snprintf(text, sizeof text, "%+.1f %%", 100 * (bytes / before - 1));
  return text;
}

void print_row(double scale, double later, const char* preset, const Row& row, const Row& first) {
  const Worst& w = row.worst;
  const l4d_coding_errors& b = row.bound;
  std::printf("| %g | %g | %s | %zu of %zu | %s | %s | %s | %s | %s | %s | %s |\n", scale, later,
              preset, row.valid, row.scenes, of_bound(w.position, b.position_bound).c_str(),
              of_bound(w.covariance, b.covariance_bound).c_str(),
              of_bound(w.opacity, b.opacity_bound).c_str(),
              of_bound(w.base_color, b.base_color_bound).c_str(),
              of_bound(w.directional_color, b.directional_color_bound).c_str(),
              change(row.bytes[0], first.bytes[0]).c_str(),
              change(row.bytes[1], first.bytes[1]).c_str());
  std::fflush(stdout);
}

void print_sections(double scale, const char* preset, const Row& row, const Row& first) {
  constexpr const char* kNames[] = {
      "header",   "directory",      "codebooks",       "rcq tables",    "overhead",
      "position", "mean time",      "opacity",         "factor",        "sh",
      "scale",    "rotor, spatial", "rotor, temporal", "entropy tables"};
  static_assert(std::size(kNames) == L4D_SECTION_COUNT, "a section has no name");
  for (size_t kind = 0; kind < 2 && first.bytes[kind] > 0; ++kind) {
    const char* const name = kind == 0 ? "hard" : "real";
    std::printf("  %g %s, %s scenes: %llu escapes", scale, preset, name,
                static_cast<unsigned long long>(row.escapes[kind]));
    for (size_t s = 0; s < std::size(kNames); ++s) {
      const auto now = static_cast<double>(row.sections[kind][s]);
      const auto before = static_cast<double>(first.sections[kind][s]);
      std::printf("; %s %.0f, %+.2f %%", kNames[s], now, 100 * (now - before) / first.bytes[kind]);
    }
    std::printf("\n");
  }
}

bool is_wanted(const std::string& list, const std::string& preset) {
  return list.empty() || ("," + list + ",").find("," + preset + ",") != std::string::npos;
}

bool print_table(const Options& options) {
  const std::vector<NamedScene> scenes = all_scenes(options);
  std::printf(
      "| scale | times, s | preset | valid | position, sizes | covariance, factor | opacity | "
      "base colour | directional colour | bytes, hard scenes | bytes, real scenes |\n");
  std::printf("|---|---|---|---|---|---|---|---|---|---|---|\n");
  Table table;
  std::map<std::string, Row> first;
  for (const auto& [scale, later] : kUnits) {
    std::map<std::string, Row> rows;
    for (const NamedScene& scene : scenes) {
      const TestScene other = in_other_units(scene.scene, scale, later);
      for (const char* preset : kPresets) {
        if (is_wanted(options.presets, preset)) table.add(scene, other, preset, &rows[preset]);
      }
    }
    if (first.empty()) first = rows;
    for (const char* preset : kPresets) {
      if (!is_wanted(options.presets, preset)) continue;
      print_row(scale, later, preset, rows[preset], first[preset]);
      if (options.sections) print_sections(scale, preset, rows[preset], first[preset]);
    }
  }
  return table.all_kept();
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const char* value = i + 1 < argc ? argv[i + 1] : nullptr;
    if (word == "--sections") {
      options.sections = true;
    } else if (word == "--every" && value != nullptr && std::atoi(value) > 0) {
      options.every = static_cast<size_t>(std::atoi(argv[++i]));
    } else if (word == "--presets" && value != nullptr) {
      options.presets = argv[++i];
    } else {
      std::fputs(kUsage, stderr);
      return 2;
    }
  }
  try {
    return print_table(options) ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
