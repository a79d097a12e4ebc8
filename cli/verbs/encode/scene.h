// SPDX-License-Identifier: Apache-2.0
// The scene that is encoded, with what the options state of it.
#pragma once

#include "cli/verbs/encode/arguments.h"

namespace l4d::cli {

// Changes what the scene states of itself to what the options say.
void change_statements(const EncodeArguments& arguments, l4d_rendering* rendering,
                       l4d_presentation* presentation);
// The scene, with what the options state of it. before: what the piece before states.
LoadedScene load(Context& context, const EncodeArguments& arguments, const Input& input,
                 bool may_be_empty = false, const l4d_presentation* before = nullptr);
// Gives the encoder a scene and what the cameras say of it. told: borrowed by the encoder.
void set_scene(Context& context, const EncodeArguments& arguments, const io::Scene& scene,
               const EncoderHandle& encoder, EncoderImportance* told);

}  // namespace l4d::cli
