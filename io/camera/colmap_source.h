// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "io/camera/read_cameras.h"
#include "io/file/file.h"

// What the files of a COLMAP model are made of.
namespace l4d::io {

// A number of a text, which may be inf or nan: who reads it says whose it is.
inline bool take_number(std::istream& words, double* value) {
  std::string word;
  if (!(words >> word)) return false;
  char* end = nullptr;
  *value = std::strtod(word.c_str(), &end);
  return end != word.c_str() && *end == 0;
}

// A whole number from 0 on.
inline bool take_whole(std::istream& words, uint64_t* value) {
  constexpr double kMost = 9007199254740992;  // above, doubles do not hold all of them
  double number = 0;
  if (!take_number(words, &number)) return false;
  if (!(number >= 0 && number <= kMost && number == std::floor(number))) return false;
  *value = static_cast<uint64_t>(number);
  return true;
}

inline bool has_words(std::istream& words) { return !(words >> std::ws).eof(); }

// What is left of a line, without blanks around it.
inline std::string rest_of(std::istream& words) {
  static constexpr char kBlanks[] = " \t\r";
  std::string text;
  std::getline(words, text);
  const size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string::npos) return "";
  return text.substr(begin, text.find_last_not_of(kBlanks) + 1 - begin);
}

// Numbers of a binary file, or words of a text: one after the other.
class ColmapSource {
 public:
  // Counts the file, and what its entries become: no more than kGrowth times its bytes.
  ColmapSource(const std::string& path, const Hold& holder) : place_{path, ""} {
    is_text_ = std::filesystem::path(path).extension() == ".txt";
    InputFile file(path, holder);
    memory_ = hold(holder, (1 + kGrowth) * file.size(), path);
    bytes_.resize(static_cast<size_t>(file.size()));
    bytes_.resize(file.read(bytes_.data(), bytes_.size()));
  }
  bool is_text() const { return is_text_; }
  const CameraPlace& place() const { return place_; }
  [[noreturn]] void fail(const std::string& what) const {
    place_.fail((is_text_ ? "line " + std::to_string(line_) : "byte " + std::to_string(at_)) +
                ": " + what);
  }

  template <typename T>
  T take() {
    T value{};
    if (bytes_.size() - at_ < sizeof(T)) fail("the file ends early");
    std::memcpy(&value, &bytes_[at_], sizeof(T));
    at_ += sizeof(T);
    return value;
  }
  // How many entries of at least `least` bytes follow.
  uint64_t count(size_t least) {
    const uint64_t n = take<uint64_t>();
    if (n > (bytes_.size() - at_) / least) fail("the file is too short for its entries");
    return n;
  }
  void skip(uint64_t entries, uint64_t bytes) {
    if (entries > (bytes_.size() - at_) / bytes) fail("the file ends early");
    at_ += static_cast<size_t>(entries * bytes);
  }
  // Fails where a binary file has more than its entries.
  void finish() const {
    if (at_ != bytes_.size()) {
      fail(std::to_string(bytes_.size() - at_) + " bytes follow the entries that are stated");
    }
  }
  std::string name() {
    const auto from = bytes_.begin() + static_cast<ptrdiff_t>(at_);
    const auto end = std::find(from, bytes_.end(), uint8_t{0});
    if (end == bytes_.end()) fail("a name does not end");
    std::string text(from, end);
    at_ += text.size() + 1;
    return text;
  }
  // The next line of a text that is no comment; false at the end. Empty lines count.
  bool line(std::istringstream* words) {
    while (at_ < bytes_.size()) {
      const auto from = bytes_.begin() + static_cast<ptrdiff_t>(at_);
      const auto end = std::find(from, bytes_.end(), uint8_t{'\n'});
      const std::string text(from, end);
      at_ += text.size() + 1;
      ++line_;
      if (!text.empty() && text[0] == '#') {
        read_comment(text);
        continue;
      }
      words->clear();
      words->str(text);
      return true;
    }
    at_ = bytes_.size();
    return false;
  }
  // The next line of a text that is neither a comment nor empty; false at the end.
  bool entry(std::istringstream* words) {
    while (line(words)) {
      if (has_words(*words)) return true;
    }
    return false;
  }
  // How many images a comment before that line says there are.
  const std::optional<uint64_t>& stated_images() const { return stated_images_; }

 private:
  static constexpr uint64_t kGrowth = 4;

  // "# Number of images: 6, mean observations per image: 12.5"
  void read_comment(const std::string& text) {
    static constexpr char kBegin[] = "# Number of images: ";
    if (text.compare(0, sizeof(kBegin) - 1, kBegin) != 0) return;
    std::istringstream words(text.substr(sizeof(kBegin) - 1));
    if (uint64_t stated = 0; words >> stated) stated_images_ = stated;
  }

  CameraPlace place_;
  bool is_text_ = false;
  std::shared_ptr<void> memory_;
  std::vector<uint8_t> bytes_;
  size_t at_ = 0;
  size_t line_ = 0;  // of a text: the number of the one read last
  std::optional<uint64_t> stated_images_;
};

}  // namespace l4d::io
