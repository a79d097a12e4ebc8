// SPDX-License-Identifier: Apache-2.0
// The program l4dtrain_pages, a part of the build that is not installed: the man page and the
// completions of l4dtrain.
#include "pages/manual.h"
#include "training/cli/command.h"

int main(int argc, char** argv) {
  const l4d::train::Command command;
  l4d::pages::Manual manual = l4d::pages::manual_of(command.app);
  manual.overview = {
      "Trains scenes of 4D Gaussians from the videos or images of calibrated cameras, and encodes "
      "them to streams (.l4d) that l4dcodec plays.",
      "A capture is a folder: cameras.json, transforms.json (nerfstudio, instant-ngp), "
      "transforms_train.json (D-NeRF), poses_bounds.npy (N3DV), intri.yml and extri.yml "
      "(SelfCap, EasyVolcap), dataset.json (HyperNeRF) or sparse/0 (COLMAP). inspect says what "
      "is read of it."};
  manual.exit_statuses = l4d::train::exit_statuses();
  manual.see_also = ".BR l4dcodec (1),\n.BR ffmpeg (1),\nwhich reads videos for this tool\n";
  return l4d::pages::write_pages(manual, argc, argv);
}
