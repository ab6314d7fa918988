# Writes the source OUT of page_files.h with the contents of FILES.
set(arrays "")
set(entries "")
set(n 0)
foreach(file IN LISTS FILES)
  file(READ "${file}" bytes HEX)
  file(SHA256 "${file}" hash)
  string(SUBSTRING "${hash}" 0 16 tag)
  string(REGEX REPLACE "(..)" "0x\\1," bytes "${bytes}")
  string(REGEX REPLACE "((0x..,){24})" "\\1\n" bytes "${bytes}")
  get_filename_component(name "${file}" NAME)
  get_filename_component(ending "${file}" LAST_EXT)
  if(ending STREQUAL ".html")
    set(type "text/html; charset=utf-8")
  elseif(ending STREQUAL ".css")
    set(type "text/css; charset=utf-8")
  else()
    set(type "text/javascript; charset=utf-8")
  endif()
  if(name STREQUAL "index.html")
    set(name "")
  endif()
  string(APPEND arrays "constexpr unsigned char kFile${n}[] = {\n${bytes}0};\n")
  string(APPEND entries
    "      {\"/${name}\", \"${type}\", text_of(kFile${n}, sizeof kFile${n} - 1), \"\\\"${tag}\\\"\"},\n")
  math(EXPR n "${n} + 1")
endforeach()
file(WRITE "${OUT}" "// Made by embed.cmake.
#include \"agent/http/page_files.h\"

#include <algorithm>
#include <array>
#include <cstddef>

namespace fxagent {
namespace {

${arrays}
std::string_view text_of(const unsigned char* bytes, std::size_t size) {
  return {reinterpret_cast<const char*>(bytes), size};
}

}  // namespace

const PageFile* page_file(std::string_view path) {
  static const std::array<PageFile, ${n}> files{{
${entries}  }};
  const auto found = std::find_if(files.begin(), files.end(),
                                  [&](const PageFile& file) { return file.path == path; });
  return found == files.end() ? nullptr : &*found;
}

}  // namespace fxagent
")
