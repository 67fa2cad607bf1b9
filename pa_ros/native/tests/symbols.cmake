# Fails if an object defines symbols that the linker may merge outside the level's namespace.
execute_process(COMMAND ${NM} -C --defined-only ${OBJECT} OUTPUT_VARIABLE symbols
  COMMAND_ERROR_IS_FATAL ANY)
string(REGEX MATCHALL "[^\n]* [WVu] [^\n]*" merged "${symbols}")
list(FILTER merged EXCLUDE REGEX "pa::${LEVEL}::|DW.ref.__gxx_personality_v0")
if(merged)
  message(FATAL_ERROR "expected nothing shared in ${OBJECT}, got: ${merged}")
endif()
