// SPDX-License-Identifier: Apache-2.0
#include "cli/reference/reference_command.h"

#include <cstdio>
#include <filesystem>

#include "cli/common/revision.h"
#include "cli/common/tools_names.h"
#include "cli/reference/completion.h"
#include "cli/reference/man_pages.h"
#include "text/output_file.h"

namespace forcegrid::cli {
namespace {

int completion_command(const Command& program, const std::string& shell) {
  const std::string script = shell == "bash" ? bash_completion(program) : zsh_completion(program);
  std::fputs(script.c_str(), stdout);
  return 0;
}

int man_pages_command(const Command& program, const std::string& folder) {
  std::filesystem::create_directories(folder);
  for (const auto& [name, page] : man_pages(program, program_version())) {
    text::OutputFile file((std::filesystem::path(folder) / name).string());
    file.stream() << page;
    file.finish();
  }
  return 0;
}

}  // namespace

void add_reference(Command& program, ReferenceOptions& options, std::function<int()>& action) {
  Command& completion = program.add_subcommand("completion", tools_description("completion"));
  completion.add_option("SHELL", options.shell, "Shell")
      ->check(one_of({"bash", "zsh"}))
      ->required();
  completion.footer(
      "The packages install it. For one session: source <(forcegrid completion bash)");
  completion.callback([&program, &options, &action] {
    action = [&program, &options] { return completion_command(program, options.shell); };
  });
  Command& pages = program.add_subcommand("man-pages", tools_description("man-pages"));
  pages.add_option("DIR", options.folder, "Folder, which is made if it is missing")->required();
  pages.callback([&program, &options, &action] {
    action = [&program, &options] { return man_pages_command(program, options.folder); };
  });
}

}  // namespace forcegrid::cli
