// Starts the program anew in the same process.
#pragma once

namespace fxagent {

/// Replaces the program by a fresh copy of itself with the same arguments. Closes every file except
/// stdin, stdout and stderr. Ends the process if that fails; its service manager restarts it.
[[noreturn]] void restart_program();
/// True in a program that restart_program() has begun.
bool was_restarted();

}  // namespace fxagent
