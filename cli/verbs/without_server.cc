// SPDX-License-Identifier: Apache-2.0
// What a build without the HTTP library has in place of serve and view.

namespace l4d::cli {
namespace {

void add_missing(Registry& registry, const std::string& name) {
  add_verb(registry, name, "Not in this build, which has no HTTP server",
           [name](Context&) -> Outcome {
             throw Failure(L4D_ERR_FEATURE_UNSUPPORTED,
                           name +
                               ": this build has no HTTP server (libmicrohttpd-dev, "
                               "L4D_BUILD_VIEW)");
           })
      ->take_anything();
}

}  // namespace

void add_serve(Registry& registry) { add_missing(registry, "serve"); }
void add_view(Registry& registry) { add_missing(registry, "view"); }

}  // namespace l4d::cli
