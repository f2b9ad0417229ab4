#pragma once

namespace forcegrid::cli {

/// The exit status of a command that would end with `status`: 1 in place of 0 if something that it
/// wrote to standard output is lost (a full disk), which is then said on standard error. A reader
/// that has ended before (`forcegrid config | head`) has what it wanted.
int status_with_output(int status);

}  // namespace forcegrid::cli
