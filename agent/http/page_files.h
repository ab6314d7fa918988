// The files of the page (page/), which the build puts into the program. Any thread.
#pragma once

#include <string>
#include <string_view>

namespace fxagent {

struct PageFile {
  std::string_view path;  ///< "/app.js"; index.html is "/"
  const char* type;       ///< Content-Type
  std::string_view body;
  std::string etag;  ///< with its quotes; differs between versions of the file
};

/// Returns nullptr if the page has no such file.
const PageFile* page_file(std::string_view path);

}  // namespace fxagent
