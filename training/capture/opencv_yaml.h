// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "io/file/memory.h"

namespace l4d::train {

// What a YAML file of OpenCV's FileStorage has at its top level: matrices and numbers as lists of
// numbers, sequences of texts as lists of texts.
struct YamlFile {
  std::map<std::string, std::vector<double>> numbers;
  std::map<std::string, std::vector<std::string>> texts;
};

// Reads the part of YAML that OpenCV writes: `key: !!opencv-matrix` with rows, cols, dt and data,
// `key: 1.5`, `key: [1, 2]`, and `key:` with a list of texts below. Throws io::Error(CORRUPT) that
// names file and line; a key twice is wrong. holder: counts what reading takes.
YamlFile read_opencv_yaml(const std::string& path, const io::Hold& holder = {});

}  // namespace l4d::train
