// SPDX-License-Identifier: Apache-2.0
// Rows that are not in the back end: the store, and what moves rows.
#include "training/model/buckets.h"

#include <gmock/gmock.h>
#include <sys/resource.h>

#include <csignal>
#include <random>
#include <set>

#include "training/step/residence.h"
#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

using test::Folder;

constexpr double kDuration = 64;

// Rows whose columns all differ, visible for 0.1 s to 30 s each.
ModelState model_of_rows(uint64_t count, uint64_t capacity) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(0, 1);
  ModelState model;
  model.allocate(capacity, 1);
  uint32_t next = 1;
  for_each_column(
      [&](const std::string&, size_t, auto& column) {
        for (auto& number : column) {
          number = static_cast<std::decay_t<decltype(number)>>(next++ % 100003);
        }
      },
      model);
  for (size_t i = 0; i < capacity; ++i) {
    model.id[i] = static_cast<uint32_t>(3 * i);
    model.away[i] = 0;
    std::fill_n(&model.value.rotor[8 * i], 8, 0.0f);
    model.value.rotor[8 * i] = 1;
    std::fill_n(&model.value.log_scale[4 * i], 3, -1.0f);
    model.value.log_scale[4 * i + 3] = std::log(0.01f * std::pow(300.0f, uniform(random)));
    model.value.mean_t[i] = static_cast<float>(kDuration) * uniform(random);
  }
  model.count = count;
  model.next_id = static_cast<uint32_t>(3 * capacity);
  return model;
}

void expect_same_rows(const ModelState& a, const ModelState& b) {
  ASSERT_EQ(a.count, b.count);
  for_each_column(
      [&](const std::string& name, size_t numbers, const auto& x, const auto& y) {
        const size_t n = static_cast<size_t>(a.count) * numbers;
        EXPECT_TRUE(std::equal(x.begin(), x.begin() + static_cast<ptrdiff_t>(n), y.begin()))
            << name;
      },
      a, b);
}

const BucketStore::Wanted all([](const RowSpan&) { return true; });

BucketOptions options_of(const std::string& folder, uint64_t memory) {
  BucketOptions options;
  options.folder = folder;
  options.memory = memory;
  options.arena_bytes = 10000;
  options.duration = kDuration;
  return options;
}

size_t files_in(const std::string& folder) {
  if (!std::filesystem::exists(folder)) return 0;
  size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    files += entry.is_regular_file() ? 1U : 0U;
  }
  return files;
}

TEST(Buckets, GiveBackWhatTheyTookFromMemoryAndFiles) {
  const Folder folder;
  const ModelState model = model_of_rows(700, 700);
  for (const uint64_t memory : {uint64_t{1} << 30, uint64_t{60000}, uint64_t{0}}) {
    BucketStore store(options_of(folder / "buckets", memory));
    store.add(model);
    EXPECT_EQ(store.rows(), 700U);
    EXPECT_LE(store.memory_bytes(), memory);
    EXPECT_EQ(store.file_bytes() > 0, memory < 100000) << memory;
    EXPECT_EQ(files_in(folder / "buckets") > 0, memory < 100000);
    expect_same_rows(store.copy(all), model);

    // Some rows, and then the others.
    const std::vector<TimeInterval> times = {{10, 12}, {40, 41}};
    const BucketStore::Wanted wanted(times);
    const uint64_t count = store.count(wanted);
    const BucketStore::Wanted one_by_one(
        [&](const RowSpan& span) { return meets_any(span, times); });
    EXPECT_EQ(count, store.count(one_by_one));
    const ModelState some = store.take(wanted);
    EXPECT_EQ(some.count, count);
    EXPECT_GT(count, 50U);
    EXPECT_LT(count, 600U);
    for (const RowSpan& span : spans_of(some)) EXPECT_TRUE(wanted(span));
    EXPECT_EQ(store.count(wanted), 0U);
    EXPECT_EQ(store.count(one_by_one), 0U);
    expect_same_rows(merged(some, store.copy(all), 700), model);
    store.add(some);
    expect_same_rows(store.take(all), model);
    EXPECT_EQ(store.rows() + store.memory_bytes() + store.file_bytes(), 0U);
    EXPECT_EQ(files_in(folder / "buckets"), 0U);
  }
}

// Every instant at which a Gaussian is visible is in its span.
TEST(Buckets, SpansContainAllThatIsVisible) {
  const ModelState model = model_of_rows(500, 500);
  const std::vector<RowSpan> spans = spans_of(model);
  uint64_t visible = 0;
  for (size_t i = 0; i < spans.size(); ++i) {
    float p[3][4];
    const Slice4D<float> slice =
        slice_attributes<float>(&model.value.rotor[8 * i], &model.value.log_scale[4 * i], p);
    for (double t = 0; t < kDuration; t += 0.05) {
      const float dt = static_cast<float>(t - static_cast<double>(model.value.mean_t[i]));
      if (!is_visible(slice.lambda, dt)) continue;
      ++visible;
      EXPECT_TRUE(meets(spans[i], {t, t})) << i << " at " << t;
    }
  }
  EXPECT_GT(visible, 1000U);
  ModelState broken = model_of_rows(1, 1);
  broken.value.mean_t[0] = std::nanf("");
  EXPECT_TRUE(meets(spans_of(broken)[0], {kDuration, kDuration}));
}

TEST(Buckets, NameFilesThatAreMissingOrDamaged) {
  const Folder folder;
  const ModelState model = model_of_rows(300, 300);
  const auto expect_fails = [&](l4d_status status, const char* what, auto&& damage) {
    BucketStore store(options_of(folder / "buckets", 0));
    store.add(model);
    const std::string path =
        std::filesystem::directory_iterator(folder / "buckets")->path().string();
    damage(path);
    for (int k = 0; k < 2; ++k) {
      try {
        store.take(all);
        FAIL() << what;
      } catch (const BucketError& error) {
        EXPECT_EQ(error.status(), status);
        EXPECT_THAT(error.what(),
                    testing::AllOf(testing::HasSubstr(path), testing::HasSubstr(what)));
      }
    }
    EXPECT_EQ(store.rows(), 300U);  // no row has moved
  };
  expect_fails(L4D_ERR_IO, "cannot be read",
               [](const std::string& path) { std::filesystem::remove(path); });
  expect_fails(L4D_ERR_CORRUPT, "another length", [](const std::string& path) {
    std::filesystem::resize_file(path, std::filesystem::file_size(path) - 1);
  });
  expect_fails(L4D_ERR_CORRUPT, "another length",
               [](const std::string& path) { std::ofstream(path, std::ios::app) << 'x'; });
  expect_fails(L4D_ERR_CORRUPT, "checksum", [](const std::string& path) {
    std::string bytes = test::bytes_of(path);
    bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
    std::ofstream(path, std::ios::binary) << bytes;
  });
}

// A limit on the size of files stands for a disk that is full.
TEST(Buckets, KeepRowsThatAFullDiskDoesNotTake) {
  const Folder folder;
  const ModelState model = model_of_rows(300, 300);
  BucketStore store(options_of(folder / "buckets", 0));
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{100, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  std::string message;
  try {
    store.add(model);
  } catch (const BucketError& error) {
    message = error.what();
  }
  ::setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  EXPECT_THAT(message, testing::HasSubstr("cannot be written"));
  EXPECT_EQ(store.file_bytes(), 0U);
  EXPECT_EQ(files_in(folder / "buckets"), 0U);
  expect_same_rows(store.take(all), model);
}

TEST(Buckets, RemoveWhatAKilledProcessLeft) {
  const Folder folder;
  std::filesystem::create_directories(folder / "buckets");
  std::ofstream(folder / "buckets/3-1-8.rows") << "rows";
  std::ofstream(folder / "buckets/notes.txt") << "someone's";
  std::ofstream(folder / "buckets/table.rows") << "someone's";
  remove_buckets(folder / "buckets");
  EXPECT_FALSE(std::filesystem::exists(folder / "buckets/3-1-8.rows"));
  EXPECT_TRUE(std::filesystem::exists(folder / "buckets/notes.txt"));
  EXPECT_TRUE(std::filesystem::exists(folder / "buckets/table.rows"));
  for (const char* name : {"3-1-8.rows", "0-0-0.rows.tmp", "24-100-1234567.rows"}) {
    EXPECT_TRUE(is_bucket_name(name)) << name;
  }
  for (const char* name : {"", "rows", ".rows", "3.rows", "3-1.rows", "3-1-.rows", "3-1-8",
                           "-1-1-8.rows", "a-1-8.rows"}) {
    EXPECT_FALSE(is_bucket_name(name)) << name;
  }
}

// A link to another disk is where rows go, and a file of the name is somebody's.
TEST(Buckets, KeepLinksAndFilesOfTheirName) {
  test::Folder folder;
  std::filesystem::create_directory(folder / "disk");
  std::filesystem::create_directory_symlink(folder / "disk", folder / "buckets");
  std::ofstream(folder / "disk/0-0-1.rows") << "rows";
  std::ofstream(folder / "file") << "mine";
  for (const char* name : {"buckets", "file"}) {
    remove_buckets(folder / name);
    BucketStore(options_of(folder / name, 0)).clear();
  }
  EXPECT_TRUE(std::filesystem::is_symlink(folder / "buckets"));
  EXPECT_TRUE(std::filesystem::is_empty(folder / "disk"));
  EXPECT_EQ(test::bytes_of(folder / "file"), "mine");
}

class ResidenceTest : public testing::Test {
 protected:
  ResidenceTest() : backend_(make_cpu_backend(1)) {}
  Folder folder_;
  std::unique_ptr<Backend> backend_;
  l4d_timeline timeline_{};
};

TEST_F(ResidenceTest, KeepsWhatTheWindowsNeed) {
  const ModelState model = model_of_rows(600, 600);
  Residence residence(backend_.get(), options_of(folder_ / "buckets", 50000), 400);
  ModelState start = model;
  std::fill(start.away.begin(), start.away.end(), 1U);
  residence.place(start, timeline_);
  EXPECT_EQ(backend_->count(), 0U);
  EXPECT_EQ(residence.count(), 600U);
  std::set<uint32_t> seen;
  uint64_t step = 0;
  for (const double t : {3.0, 30.0, 31.0, 60.0, 3.0}) {
    const std::vector<TimeInterval> windows = {{t, t + 2}, {t + 1.5, t + 4}};
    ASSERT_TRUE(residence.renew(windows, step += 50));
    EXPECT_EQ(backend_->count(), residence.needed());
    EXPECT_EQ(residence.count(), 600U);
    const ModelState here = backend_->save();
    EXPECT_TRUE(
        std::is_sorted(here.id.begin(), here.id.begin() + static_cast<ptrdiff_t>(here.count)));
    seen.insert(here.id.begin(), here.id.begin() + static_cast<ptrdiff_t>(here.count));
    for (const RowSpan& span : spans_of(model)) {
      EXPECT_EQ(std::binary_search(here.id.begin(),
                                   here.id.begin() + static_cast<ptrdiff_t>(here.count), span.id),
                meets_any(span, windows));
    }
    ModelState whole = residence.whole();
    // A row that was away is as it was but for what counts steps that do not show it.
    for (size_t i = 0; i < 600; ++i) {
      const bool is_here = whole.away[i] == 0;
      EXPECT_GE(whole.last_shown[i], model.last_shown[i]);
      EXPECT_EQ(is_here, meets_any(spans_of(model)[i], windows));
    }
    whole.away = model.away;
    whole.last_shown = model.last_shown;
    expect_same_rows(whole, model);
  }
  EXPECT_GT(seen.size(), 150U);
  // The whole sequence does not fit: nothing moves.
  const uint64_t before = backend_->count();
  EXPECT_FALSE(residence.renew({{0, kDuration}}, step));
  EXPECT_EQ(residence.needed(), 600U);
  EXPECT_EQ(backend_->count(), before);
}

// Renders of other instants change nothing.
TEST_F(ResidenceTest, VisitsLeaveNoTrace) {
  ModelState start = model_of_rows(600, 600);
  std::fill(start.away.begin(), start.away.end(), 1U);
  Residence residence(backend_.get(), options_of(folder_ / "buckets", 50000), 330);
  residence.place(start, timeline_);
  ASSERT_TRUE(residence.renew({{20, 24}, {40, 41}}, 10));
  const ModelState here = backend_->save(), whole = residence.whole();
  for (const double t : {1.0, 55.0, 55.0, 22.0}) {
    ASSERT_TRUE(residence.visit(t));
    uint64_t visible = 0;
    const ModelState there = backend_->save();
    for (const RowSpan& span : spans_of(start)) {
      if (!meets(span, {t, t})) continue;
      ++visible;
      EXPECT_TRUE(std::binary_search(
          there.id.begin(), there.id.begin() + static_cast<ptrdiff_t>(there.count), span.id));
    }
    EXPECT_GT(visible, 20U);
    EXPECT_EQ(residence.rows_at(t).count, visible);
  }
  residence.come_home();
  expect_same_rows(backend_->save(), here);
  expect_same_rows(residence.whole(), whole);
}

TEST(Residence, MakesIntervalsOfInstants) {
  std::vector<TimeInterval> times;
  for (int k = 0; k < 7; ++k) times.push_back({0.5 * k, 0.5 * k + 0.01});
  const std::vector<TimeInterval> parts = intervals_of(times, {0, 1, 2, 4, 6});
  ASSERT_EQ(parts.size(), 3U);
  EXPECT_EQ(parts[0].end, 1.01);
  EXPECT_EQ(parts[1].begin, 2);
  EXPECT_EQ(parts[1].end, 2.01);
  EXPECT_EQ(parts[2].end, 3.01);
}

}  // namespace
}  // namespace l4d::train
