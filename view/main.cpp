// SPDX-License-Identifier: Apache-2.0
// forcegrid-view: the server of the live view (docs/view_protocol.md).
#include <cstdio>
#include <exception>
#include <optional>
#include <span>
#include <utility>

#include "view/access.h"
#include "view/certificate.h"
#include "view/export_server.h"
#include "view/log_line.h"
#include "view/options.h"
#include "view/page_files.h"
#include "view/private_folder.h"
#include "view/server.h"

namespace {

using namespace forcegrid::view;

constexpr int kWrongUse = 2;

int run(int argc, char** argv) {
  const Options options = parse_options(std::span<const char* const>(argv, argv + argc).subspan(1));
  if (options.help) {
    std::fputs(help_text().data(), stdout);
    return 0;
  }
  if (options.version) {
    std::puts("forcegrid-view " FORCEGRID_VIEW_VERSION);
    return 0;
  }
  std::optional<Certificate> certificate;
  if (!options.key_file.empty()) {
    certificate = load_certificate(options.key_file);
  }
  const PrivateFolder folder;
  if (!options.export_file.empty()) {
    serve_export(options, load_page_files(default_page_folders()), folder.path());
    return 0;
  }
  Server server(options, std::move(certificate), token_from_environment(),
                load_page_files(default_page_folders()), folder.path());
  std::puts(server.ready_line().c_str());
  std::fflush(stdout);
  server.run();
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const ViewError& error) {
    log_line(error.what());
    return kWrongUse;
  } catch (const std::exception& error) {
    log_line(error.what());
    return 1;
  }
}
