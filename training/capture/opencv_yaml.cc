// SPDX-License-Identifier: Apache-2.0
#include "training/capture/opencv_yaml.h"

#include <charconv>
#include <sstream>

#include "io/file/file.h"

namespace l4d::train {
namespace {

// What a byte of text takes at most: as an empty line, which is 32 bytes of a list that doubles.
constexpr uint64_t kTextBytes = 128;

std::string trimmed(const std::string& text) {
  const size_t begin = text.find_first_not_of(" \t\r");
  if (begin == std::string::npos) return "";
  return text.substr(begin, text.find_last_not_of(" \t\r") - begin + 1);
}

std::string unquoted(const std::string& text) {
  const bool quoted = text.size() >= 2 && text.front() == text.back() &&
                      (text.front() == '"' || text.front() == '\'');
  return quoted ? text.substr(1, text.size() - 2) : text;
}

class Reader {
 public:
  Reader(const std::string& path, const io::Hold& holder) : path_(path) {
    io::InputFile file(path, holder);
    memory_ = io::hold(holder, kTextBytes * file.size(), path);
    std::string bytes(static_cast<size_t>(file.size()), '\0');
    bytes.resize(file.read(bytes.data(), bytes.size()));
    std::istringstream text(bytes);
    for (std::string line; std::getline(text, line);) lines_.push_back(line);
  }

  YamlFile read() {
    while (at_ < lines_.size()) {
      const std::string& line = lines_[at_];
      const std::string content = trimmed(line);
      if (content.empty() || content[0] == '%' || content[0] == '#' || content == "---") {
        ++at_;
        continue;
      }
      if (line[0] == ' ' || line[0] == '-') fail("a line is indented that belongs to no key");
      read_entry(content);
    }
    return std::move(file_);
  }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    throw io::Error(L4D_ERR_CORRUPT, path_ + ": line " + std::to_string(at_ + 1) + ": " + what);
  }

  void read_entry(const std::string& content) {
    const size_t colon = content.find(':');
    if (colon == std::string::npos) fail("no key");
    const std::string key = unquoted(trimmed(content.substr(0, colon)));
    const std::string value = trimmed(content.substr(colon + 1));
    if (file_.numbers.count(key) + file_.texts.count(key) > 0) fail(key + " is there twice");
    if (value.rfind("!!opencv-matrix", 0) == 0) {
      ++at_;
      file_.numbers[key] = read_matrix();
    } else if (value.empty()) {
      ++at_;
      file_.texts[key] = read_texts();
    } else if (value[0] == '[') {
      file_.numbers[key] = read_list(value);
    } else {
      double number = 0;
      if (parse(value, &number)) file_.numbers[key] = {number};
      file_.texts[key] = {unquoted(value)};
      ++at_;
    }
  }

  std::vector<double> read_matrix() {
    size_t rows = 0, columns = 0;
    while (at_ < lines_.size() && !lines_[at_].empty() && lines_[at_][0] == ' ') {
      const std::string content = trimmed(lines_[at_]);
      if (content.rfind("data:", 0) == 0) {
        const std::vector<double> data = read_list(trimmed(content.substr(5)));
        if (data.size() != rows * columns) fail("data does not have rows x cols numbers");
        return data;
      }
      double number = 0;
      const bool counts = content.rfind("rows:", 0) == 0 || content.rfind("cols:", 0) == 0;
      if (counts) {
        if (!parse(trimmed(content.substr(5)), &number) || !(number >= 0 && number < 1e6)) {
          fail("rows and cols are numbers");
        }
        (content[0] == 'r' ? rows : columns) = static_cast<size_t>(number);
      }
      ++at_;
    }
    fail("a matrix without data");
  }

  // From '[' to ']', which may be lines later.
  std::vector<double> read_list(std::string text) {
    if (text.empty() || text[0] != '[') fail("a list begins with [");
    size_t end = text.find(']');
    while (end == std::string::npos) {
      if (++at_ == lines_.size()) fail("a list does not end");
      const size_t before = text.size();
      text += " " + trimmed(lines_[at_]);
      end = text.find(']', before);
    }
    std::vector<double> numbers;
    std::istringstream items(text.substr(1, end - 1));
    for (std::string item; std::getline(items, item, ',');) {
      double number = 0;
      if (trimmed(item).empty()) continue;
      if (!parse(trimmed(item), &number)) fail("\"" + trimmed(item) + "\" is no finite number");
      numbers.push_back(number);
    }
    ++at_;
    return numbers;
  }

  std::vector<std::string> read_texts() {
    std::vector<std::string> texts;
    while (at_ < lines_.size()) {
      const std::string content = trimmed(lines_[at_]);
      if (content.empty() || content[0] != '-' || content == "---") break;
      texts.push_back(unquoted(trimmed(content.substr(1))));
      ++at_;
    }
    return texts;
  }

  static bool parse(const std::string& text, double* number) {
    // "1." and "+1" are numbers to OpenCV.
    const char* begin = text.data() + (!text.empty() && text[0] == '+' ? 1 : 0);
    const char* end = text.data() + text.size();
    const auto result = std::from_chars(begin, end, *number);
    return result.ec == std::errc() && result.ptr == end && *number - *number == 0;
  }

  std::string path_;
  std::shared_ptr<void> memory_;
  std::vector<std::string> lines_;
  size_t at_ = 0;
  YamlFile file_;
};

}  // namespace

YamlFile read_opencv_yaml(const std::string& path, const io::Hold& holder) {
  return Reader(path, holder).read();
}

}  // namespace l4d::train
