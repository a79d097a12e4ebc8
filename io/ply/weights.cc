// SPDX-License-Identifier: Apache-2.0
#include "io/ply/weights.h"

#include <algorithm>
#include <new>

#include "io/ply/ply.h"

namespace l4d::io {
namespace {

struct Column {
  const char* property;
  std::vector<float> Weights::*values;
  bool is_optional = false;  // in files that are written
};
// Where two properties serve one column the first one present counts.
constexpr Column kColumns[] = {{"alpha_t", &Weights::alpha_t},
                               {"weight_sh", &Weights::sh},
                               {"weight_sh_gradient", &Weights::sh},
                               {"weight_scale", &Weights::scale},
                               {"weight_rotor_spatial", &Weights::rotor_spatial},
                               {"weight_rotor_temporal", &Weights::rotor_temporal},
                               {"weight_position", &Weights::position, true},
                               {"weight_opacity", &Weights::opacity, true},
                               {"weight_mean_t", &Weights::mean_t, true}};
constexpr const char* kSum = "sum";
constexpr const char* kGaussNewton = "gauss-newton";

Weights read_weights(const std::string& path, const Hold& holder) {
  PlyReader reader(InputFile(path, holder), "vertex");
  const char* version = reader.header().comment("l4d_weights");
  if (version == nullptr) {
    reader.fail(L4D_ERR_CORRUPT, "no file of weights: the comment l4d_weights is missing");
  }
  if (std::string(version) != "1") {
    reader.fail(L4D_ERR_FEATURE_UNSUPPORTED, "a version of l4d_weights other than 1");
  }
  const char* comment = reader.header().comment("metric");
  const std::string metric = comment != nullptr ? comment : kSum;
  if (metric != kSum && metric != kGaussNewton) {
    reader.fail(L4D_ERR_FEATURE_UNSUPPORTED, "weights of the unknown metric " + metric);
  }
  Weights weights;
  weights.gauss_newton = metric == kGaussNewton;
  weights.count = static_cast<size_t>(reader.element().count);
  size_t num_known = 0;
  for (const Column& column : kColumns)
    num_known += reader.element().has(column.property) ? 1U : 0U;
  weights.memory = hold(holder, num_known * weights.count * sizeof(float), path);
  std::vector<PlyColumn> columns;
  std::vector<Column> present;
  for (const Column& known : kColumns) {
    PlyColumn column;
    column.property = reader.element().find(known.property);
    std::vector<float>& values = weights.*known.values;
    if (column.property == PlyElement::kNone || !values.empty()) continue;
    values.resize(weights.count);
    column.to_float = values.data();
    columns.push_back(column);
    present.push_back(known);
  }
  for (const PlyProperty& property : reader.element().properties) {
    const auto is_known = [&](const Column& c) { return property.name == c.property; };
    if (property.name.rfind("weight_", 0) == 0 &&
        std::none_of(std::begin(kColumns), std::end(kColumns), is_known)) {
      reader.fail(L4D_ERR_FEATURE_UNSUPPORTED, "property " + property.name + " is no known weight");
    }
  }
  if (columns.empty()) reader.fail(L4D_ERR_CORRUPT, "there is no property of weights");
  weights.sh_is_clamped = !weights.sh.empty() && !reader.element().has("weight_sh");
  reader.read_rows(columns);
  reader.finish();
  for (const Column& column : present) {
    const std::vector<float>& values = weights.*column.values;
    for (size_t i = 0; i < values.size(); ++i) {
      if (values[i] >= 0 && values[i] - values[i] == 0) continue;
      reader.fail(L4D_ERR_CORRUPT, std::string(column.property) + " of row " + std::to_string(i) +
                                       " is negative or not finite");
    }
  }
  return weights;
}

}  // namespace

l4d_importance Weights::view() const {
  l4d_importance view = L4D_INIT(l4d_importance);
  view.count = count;
  view.metric = gauss_newton ? L4D_SENSITIVITY_GAUSS_NEWTON : L4D_SENSITIVITY_SUM;
  for (const auto& [which, column] : kWeightColumns) {
    if (!(this->*column).empty()) view.weights[which] = (this->*column).data();
  }
  return view;
}

std::array<float*, L4D_WEIGHT_COUNT> Weights::make_columns(size_t num_gaussians) {
  count = num_gaussians;
  std::array<float*, L4D_WEIGHT_COUNT> columns{};
  for (const auto& [which, column] : kWeightColumns) {
    (this->*column).resize(num_gaussians);
    columns[which] = (this->*column).data();
  }
  return columns;
}

Weights read_weights_ply(const std::string& path, const Hold& holder) {
  try {
    return read_weights(path, holder);
  } catch (const std::bad_alloc&) {
    throw Error(L4D_ERR_OUT_OF_MEMORY, path + ": not enough memory for the weights");
  }
}

void write_weights_ply(const std::string& path, const Weights& weights) {
  std::vector<std::string> names;
  std::vector<const std::vector<float>*> columns;
  for (const Column& column : kColumns) {
    const std::vector<float>& values = weights.*column.values;
    if (!columns.empty() && columns.back() == &values) continue;
    if (column.is_optional && values.empty()) continue;
    if (values.size() != weights.count) {
      throw Error(L4D_ERR_INVALID_ARGUMENT,
                  path + ": " + column.property + " has not one value per Gaussian");
    }
    names.push_back(column.property);
    columns.push_back(&values);
  }
  const std::string metric = weights.gauss_newton ? kGaussNewton : kSum;
  PlyWriter writer(path, {"l4d_weights 1", "metric " + metric}, weights.count, names);
  for (size_t i = 0; i < weights.count; ++i) {
    float* out = writer.next_row();
    for (const std::vector<float>* column : columns) *out++ = (*column)[i];
  }
  writer.finish();
}

}  // namespace l4d::io
