// SPDX-License-Identifier: Apache-2.0
// The program l4dcodec_pages, a part of the build that is not installed: the man page and the
// completions of l4dcodec.
#include "cli/commands.h"
#include "pages/manual.h"

int main(int argc, char** argv) {
  const l4d::cli::CommandLine line;
  l4d::pages::Manual manual = l4d::pages::manual_of(*line.app);
  manual.overview = {
      "A codec for long dynamic scenes of 4D rotor Gaussians. It encodes PLY files to streams "
      "(.l4d), decodes them, whole or in part, and measures, checks and renders scenes.",
      "A command that takes a scene takes a stream or a PLY file. The file '-' is stdin or stdout. "
      "What follows '--' is a file and no option.",
      "Nothing is overwritten without --force, and never what the command itself reads. Output "
      "takes its name when it is complete: a failure leaves nothing behind.",
      "Times are seconds (2.5), minutes (1:30) or hours (1:02:03.5). Counts and sizes take k, M, G "
      "and T (powers of 1000), Ki, Mi, Gi and Ti (of 1024), and a B."};
  for (const l4d::cli::ExitStatus& status : l4d::cli::exit_statuses()) {
    manual.exit_statuses.emplace_back(status.code, status.meaning);
  }
  manual.see_also = ".BR ffmpeg (1),\nwhich reads and writes videos for this tool\n";
  return l4d::pages::write_pages(manual, argc, argv);
}
