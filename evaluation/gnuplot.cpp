#include "evaluation/gnuplot.h"

#include <sys/wait.h>

#include <cerrno>
#include <cstdio>
#include <cstring>

#include "evaluation/force_table.h"

namespace forcegrid::evaluation {

std::string quoted(const std::string& text) {
  std::string result = "'";
  for (const char character : text) {
    result += character == '\'' ? std::string("''") : std::string(1, character);
  }
  return result + "'";
}

void run_gnuplot(const std::string& script, const std::filesystem::path& file) {
  errno = 0;
  std::FILE* gnuplot = popen("trap '' INT; exec gnuplot 2>&1 >/dev/null", "w");
  if (gnuplot == nullptr) {
    throw ChartError(std::string("gnuplot could not be started: ") + std::strerror(errno));
  }
  std::fwrite(script.data(), 1, script.size(), gnuplot);
  const int status = pclose(gnuplot);
  if (status != 0) {
    throw ChartError("gnuplot could not draw " + file.string() + " (status " +
                     std::to_string(WIFEXITED(status) ? WEXITSTATUS(status) : status) +
                     "); install the package gnuplot-nox, free some space or choose another "
                     "folder with --out; the data lies beside it");
  }
}

}  // namespace forcegrid::evaluation
