// SPDX-License-Identifier: Apache-2.0
// The fit of opacities, and what is said of it.
#pragma once

#include <functional>
#include <optional>

#include "cli/verbs/encode/weights.h"
#include "eval/refit/refit.h"

namespace l4d::cli {

// Passes of the fit of opacities, 0 = none: by default where the encoder would otherwise drop
// Gaussians by what they cost.
uint32_t refit_passes(const EncodeArguments& arguments, const std::optional<eval::Target>& target,
                      uint32_t backend, const EncoderHandle& encoder);
// path: "" = into memory.
eval::Encoding encode_once(Context& context, const EncoderHandle& encoder, const Input& input,
                           const std::string& path, bool wants_order);
// aim: the fidelity that the coded scene is to have; 0: what follows from that of weights alone.
// search: encodes to a target, if there is one; *reached is of the encoding that is returned.
eval::Refit encode_refitted(Context& context, const EncodeArguments& arguments, const Input& input,
                            const io::Scene& scene, const EncoderHandle& encoder,
                            const Measuring& measuring, uint32_t passes, double aim,
                            EncoderImportance& told,
                            const std::function<TargetReached(eval::Encoding*)>& search,
                            std::optional<TargetReached>* reached);
void describe_refit(const eval::Refit& refit, Outcome* outcome);
void note_refit(Context& context, const eval::Refit& refit);

}  // namespace l4d::cli
