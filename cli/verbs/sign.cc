// SPDX-License-Identifier: Apache-2.0
#include <sys/stat.h>

#include <filesystem>
#include <memory>

#include "cli/command/context.h"
#include "cli/input/files.h"
#include "cli/input/signature.h"
#include "cli/verbs/verbs.h"
#include "io/file/file.h"

namespace l4d::cli {
namespace {

struct SignArguments {
  std::string input;
  std::string output;
  std::string key;
};

Outcome run_sign(Context& context, const SignArguments& arguments) {
  require_signatures("sign");
  context.files.add_input(arguments.key, "--key");
  const Input input(context, arguments.input);
  check_one_file(arguments.output, "--output", {".l4d"});
  Output output(context, arguments.output);
  if (output.is_special()) throw usage_error("--output must be a file or '-'");
  const PublicKey key = sign_file(input.path(), read_secret_key(arguments.key), output.path());
  Outcome outcome;
  outcome.stdout_is_data = output.is_stdout();
  const uint64_t bytes = output.finish();
  outcome.json = {{"schema", "l4dcodec.sign/1"},
                  {"input", input.name()},
                  {"output", arguments.output},
                  {"key", key_text(key)},
                  {"file_bytes", bytes}};
  outcome.text = arguments.output + ": signed by " + key_text(key) + "\n";
  return outcome;
}

// A key that is replaced is lost, so --force does not apply.
void refuse_existing(const std::string& path) {
  std::error_code ignored;
  if (std::filesystem::exists(std::filesystem::symlink_status(path, ignored))) {
    throw Failure(L4D_ERR_IO, path + " exists, and keygen never replaces a key");
  }
}

// hidden: permissions that nobody gets.
void write_line(const std::string& path, const std::string& line, mode_t hidden) {
  struct Mask {
    explicit Mask(mode_t mask) : before(umask(mask)) { umask(before | mask); }
    ~Mask() { umask(before); }
    mode_t before;
  };
  const Mask mask(hidden);
  io::OutputFile file(path);
  file.write(line.data(), line.size());
  file.commit();
}

Outcome run_keygen(Context& context, const std::string& name) {
  require_signatures("keygen");
  const std::string open_name = name + ".pub";
  Output secret(context, name);
  Output open(context, open_name, "the public key");
  if (secret.is_stdout() || secret.is_special() || open.is_special()) {
    throw usage_error("--output must be a file");
  }
  refuse_existing(name);
  refuse_existing(open_name);
  const KeyPair pair = make_key_pair();
  write_line(secret.path(), secret_key_line(pair.secret), S_IRWXG | S_IRWXO);
  write_line(open.path(), public_key_line(pair.open), 0);
  secret.finish();
  open.finish();
  Outcome outcome;
  outcome.json = {{"schema", "l4dcodec.keygen/1"},
                  {"secret_key_file", name},
                  {"public_key_file", open_name},
                  {"key", key_text(pair.open)}};
  outcome.text = name + ": secret key; " + open_name + ": public key " + key_text(pair.open) + "\n";
  return outcome;
}

}  // namespace

void add_sign(Registry& registry) {
  auto arguments = std::make_shared<SignArguments>();
  Verb* verb = add_verb(registry, "sign", "Sign a stream, so that others can tell that it is yours",
                        [arguments](Context& context) { return run_sign(context, *arguments); });
  verb->add_option("input", arguments->input, ".l4d to sign, '-' = stdin")->required();
  verb->add_option("-o,--output", arguments->output, "Signed stream to write, '-' = stdout")
      ->type_name("FILE")
      ->required();
  verb->add_option("--key", arguments->key, "Secret key, as `keygen` makes it")
      ->type_name("FILE")
      ->required();
  verb->footer(
      "Appends 100 bytes: an Ed25519 signature of all bytes before it. A signature that the input "
      "ends\nwith is replaced. `validate --key` checks it; players ignore it.");
}

void add_keygen(Registry& registry) {
  auto name = std::make_shared<std::string>();
  Verb* verb = add_verb(registry, "keygen", "Make a pair of keys for `sign` and `validate --key`",
                        [name](Context& context) { return run_keygen(context, *name); });
  verb->add_option("-o,--output", *name,
                   "File for the secret key, which you alone can read; the public key goes to "
                   "FILE.pub")
      ->type_name("FILE")
      ->required();
}

}  // namespace l4d::cli
