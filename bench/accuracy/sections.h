// SPDX-License-Identifier: Apache-2.0
// One function per section: makes its tables, name -> rows.
#pragma once

#include "bench/accuracy/bench.h"

namespace l4d::bench {

Json run_presets(Bench& bench);
Json run_jod(Bench& bench);
Json run_device(Bench& bench);  // fails where there is no CUDA device
Json run_ways(Bench& bench);
Json run_device_ways(Bench& bench);  // likewise
Json run_final(Bench& bench);
Json run_rate(Bench& bench);
Json run_sensitivity(Bench& bench);
Json run_codebooks(Bench& bench);
Json run_thresholds(Bench& bench);
Json run_rcq(Bench& bench);
Json run_ablation(Bench& bench);
Json run_effort(Bench& bench);
Json run_decoder(Bench& bench);
Json run_renderer(Bench& bench);
Json run_effects(Bench& bench);
Json run_stages(Bench& bench);

}  // namespace l4d::bench
